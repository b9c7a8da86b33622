"""The processing that the diagnosis proposes where the user leaves it open.

The band in which candidates are looked for is wider than that of the identification.

Rows beside a reversal count only where it is known when joints stick and slip. There dry friction
crosses from one level to the other while the joint sticks. A simulated closed loop shows when;
without one only the sign of the measured speed remains, which is wrong there by as much as the
friction, and the decimation filter smears that over the rows around.
"""

from collections.abc import Iterator, Sequence
from math import ceil

import numpy as np
from scipy.signal import welch

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.estimation.least_squares import solve_least_squares
from idim_iv_ros.estimation.observation import observation_rows
from idim_iv_ros.identification.prepare import PreparedRegression, prepare, require_excitation
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import joint_inertia
from idim_iv_ros.types import FloatArray

_NYQUIST_MARGIN = 1.3  # of half of the sampling rate over the proposed cut-off of the positions
_NOISE_SEGMENT = 2.0  # s of the spectrum from which the noise of the sensors is read
_HIGHEST_CUTOFF = 0.4  # of the sampling rate: cut-off of the positions that is proposed at most


def proposals(
    sets: Sequence[Sequence[Recording]], configuration: Configuration
) -> Iterator[Configuration]:
    """Processing in the order in which it is tried: of a loop that is simulated, and of none.

    Each is that of the narrowest band of the sets, with a model that has torque offsets, but those
    that it excludes.

    `sets`: recordings that are refitted apart from one another in one band.
    """
    friction = configuration.identification.friction
    if "offset" not in friction:
        configuration = configuration.changed("identification", friction=[*friction, "offset"])
    may_be = all(recording.position_reference is not None for part in sets for recording in part)
    for simulated in (True, False) if may_be else (False,):
        options = [widened(part, configuration, simulated=simulated).processing for part in sets]
        narrow = min(options, key=lambda option: option.decimation_cutoff or 0.0)
        positions = [option.position_cutoff for option in options if option.position_cutoff]
        if positions and configuration.processing.position_cutoff is None:
            position = max(min(positions), narrow.decimation_cutoff or 0.0)
            narrow = narrow.model_copy(update={"position_cutoff": position})
        if simulated:
            counting = {"reversal_margin": narrow.reversal_margin or 0.0}
            narrow = narrow.model_copy(update=counting)
        yield configuration.model_copy(update={"processing": narrow})


def widened(
    recordings: Sequence[Recording],
    configuration: Configuration,
    *,
    simulated: bool = True,
) -> Configuration:
    """Propose a decimation cut-off for the diagnosis where the user names none.

    What distinguishes effects (ripple, shafts, play, delays) lies higher than what identifies
    inertias. Noise of encoders costs little there: it is in the noise by whose spectrum rows are
    weighted. White noise of standard deviation σ_q at the positions gives the torque of an inertia
    J the density J² σ_q² (2πf)⁴; the band ends where its power is s² times that of the torque's
    noise, (2πf)² = √5 s σ_τ / (J σ_q): beyond, a coarse encoder's steps pass for a soft shaft.
    Where no simulated motion is joined, this noise is in the columns of every candidate, and what
    is late averages it: beyond s = 1 it passes for a delay.

    `simulated`: whether the closed loop is.
    """
    processing = configuration.processing
    if processing.decimation_cutoff is not None:
        return configuration
    prepared = prepare(recordings, configuration)
    rate = min(motion.signals.rate for motion in prepared.motions)
    measured = min(rate, *map(_effort_rate, recordings))
    sampled = measured / (2.0 * settings.POSITION_OVER_DECIMATION * _NYQUIST_MARGIN)
    noise = settings.ACCELERATION_NOISE if simulated else settings.MEASURED_NOISE
    cutoff = min(_noise_limit(prepared, noise), settings.WIDEST_BAND, sampled)
    cutoff = max(cutoff, prepared.cutoffs.decimation)
    edge = processing.decimation_edge
    factor = max(1, int(edge * rate / (2.0 * cutoff)))
    if factor > settings.SAMPLES_PER_ROW:  # a multiple, so that candidates need a coarse grid only
        most = round if simulated else ceil
        factor = settings.SAMPLES_PER_ROW * most(factor / settings.SAMPLES_PER_ROW)
    cutoff = edge * rate / (2.0 * factor)
    position = processing.position_cutoff
    if position is None:
        wanted = max(prepared.cutoffs.position, settings.POSITION_OVER_DECIMATION * cutoff)
        position = min(wanted, _HIGHEST_CUTOFF * rate)
    cutoffs = {"position_cutoff": position, "decimation_cutoff": min(cutoff, position)}
    return configuration.changed("processing", **cutoffs)


def _effort_rate(recording: Recording) -> float:
    """Hz at which efforts are measured: those of a slower topic are interpolated to the grid."""
    topic = recording.effort.origin.rpartition(" ")[0]
    return next((clock.rate for clock in recording.clocks if clock.topic == topic), recording.rate)


def _noise_limit(prepared: PreparedRegression, noise: float) -> float:
    """Hz, the least over the joints, at which accelerations add `noise` times the torque's."""
    model, motions = prepared.model, prepared.motions
    rows = observation_rows(model, motions)
    require_excitation(prepared, rows)
    values = solve_least_squares(rows, len(model.base.columns)).values
    parameters = model.dynamic_parameters(values)
    inertia = np.abs(joint_inertia(model.robot, parameters, motions[0].position))
    noise_of_inertia = np.maximum(inertia * _noise(motions, "position"), 1e-30)
    ratio = _noise(motions, "torque") / noise_of_inertia
    return float(np.sqrt(np.sqrt(5.0) * noise * ratio.min())) / (2.0 * np.pi)


def _noise(motions: Sequence[Motion], quantity: str) -> FloatArray:
    """Standard deviation (n_joints,) of the noise in single samples: the upper half of the band."""
    variances = []
    for motion in motions:
        values, rate = getattr(motion.signals, quantity), motion.signals.rate
        segment = min(len(values), max(64, int(_NOISE_SEGMENT * rate)))
        frequency, density = welch(values, fs=rate, nperseg=segment, axis=0)
        upper = density[frequency > 0.25 * rate]
        variances.append(np.median(upper, axis=0) * rate / 2.0)
    return np.asarray(np.sqrt(np.mean(variances, axis=0)))
