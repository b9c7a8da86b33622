"""The band in which candidates are looked for: as wide as the encoders' noise allows."""

from collections.abc import Sequence

import numpy as np
from scipy.signal import welch

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.estimation.least_squares import solve_least_squares
from idim_iv_ros.estimation.observation import observation_rows
from idim_iv_ros.identification.prepare import PreparedRegression, prepare, require_excitation
from idim_iv_ros.recording import Recording
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import joint_inertia
from idim_iv_ros.types import FloatArray


def widened(recordings: Sequence[Recording], configuration: Configuration) -> Configuration:
    """Propose a decimation cut-off for the diagnosis where the user names none.

    What tells effects apart (ripple, shafts, delays) lies higher than what identifies inertias.
    White noise of standard deviation σ_q at the positions gives the torque of an inertia J the
    density J² σ_q² (2πf)⁴; up to f its power is a share s² of the torque's own noise for
    (2πf)² = √5 s σ_τ / (J σ_q).
    """
    processing = configuration.processing
    if processing.decimation_cutoff is not None:
        return configuration
    prepared = prepare(recordings, configuration)
    rate = min(motion.signals.rate for motion in prepared.motions)
    highest = min(
        settings.WIDEST_BAND,
        rate / (2.0 * settings.POSITION_OVER_DECIMATION * settings.NYQUIST_MARGIN),
    )
    cutoff = max(min(_noise_limit(prepared), highest), prepared.cutoffs.decimation)
    edge = processing.decimation_edge
    factor = max(1, int(edge * rate / (2.0 * cutoff)))
    if factor > settings.SAMPLES_PER_ROW:  # a multiple, so that candidates need a coarse grid only
        factor += -factor % settings.SAMPLES_PER_ROW
    cutoff = edge * rate / (2.0 * factor)
    position = processing.position_cutoff
    if position is None:
        position = min(
            max(prepared.cutoffs.position, settings.POSITION_OVER_DECIMATION * cutoff),
            settings.HIGHEST_CUTOFF * rate,
        )
    changed = processing.model_copy(
        update={
            "position_cutoff": position,
            "decimation_cutoff": min(cutoff, position),
        }
    )
    return configuration.model_copy(update={"processing": changed})


def _noise_limit(prepared: PreparedRegression) -> float:
    """Hz, the least over the joints."""
    rows = observation_rows(prepared.model, prepared.motions)
    require_excitation(prepared, rows)
    values = solve_least_squares(rows, len(prepared.model.base.columns)).values
    position = prepared.motions[0].position
    model = prepared.model
    sample = position[:: max(1, len(position) // 50)]
    inertia = joint_inertia(model.robot, model.dynamic_parameters(values), sample)
    position_noise = _noise(prepared.motions, "position")
    torque_noise = _noise(prepared.motions, "torque")
    ratio = torque_noise / np.maximum(np.abs(inertia) * position_noise, 1e-30)
    return float(np.sqrt(np.sqrt(5.0) * settings.ACCELERATION_NOISE * ratio.min())) / (2.0 * np.pi)


def _noise(motions: Sequence[Motion], quantity: str) -> FloatArray:
    """Standard deviation (n_joints,) of the noise in single samples: the upper half of the band."""
    variances = []
    for motion in motions:
        values = getattr(motion.signals, quantity)
        rate = motion.signals.rate
        segment = min(len(values), max(64, int(settings.NOISE_SEGMENT * rate)))
        frequency, density = welch(values, fs=rate, nperseg=segment, axis=0)
        upper = density[frequency > 0.25 * rate]
        variances.append(np.median(upper, axis=0) * rate / 2.0)
    return np.asarray(np.sqrt(np.mean(variances, axis=0)))
