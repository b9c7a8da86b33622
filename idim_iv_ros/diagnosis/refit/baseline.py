"""The refit: the model that every candidate is added to, and the rows that it leaves.

Its processing is proposed where the user leaves it open. The band in which candidates are looked
for is wider than that of the identification. Rows beside a reversal count only where it is known
when joints stick and slip. There dry friction crosses from one level to the other while the joint
sticks. A simulated closed loop shows when; without one only the sign of the measured speed remains,
which is wrong there by as much as the friction, and the decimation filter smears that over the rows
around.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.command_rows import LawCommands, with_law_speed
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion, dynamics_of, smooth_motions
from idim_iv_ros.diagnosis.result.causes import JointChange
from idim_iv_ros.effects.cause import Parameters
from idim_iv_ros.effects.effect import Effect, JointRange, Place, Shape
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate, idim_iv
from idim_iv_ros.estimation.instruments import InstrumentSources, instrument_sources
from idim_iv_ros.estimation.least_squares import solve_least_squares
from idim_iv_ros.estimation.likelihood import Columns, Regression, rms, width_of
from idim_iv_ros.estimation.observation import observation_rows, torque_rows
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.identification.prepare import PreparedRegression, prepare, require_excitation
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.signals.filters import shifted
from idim_iv_ros.signals.motion import Motion, noise_density
from idim_iv_ros.simulation import joint_inertia
from idim_iv_ros.types import FloatArray, IntArray

_PRISMATIC_LEVER = 0.1  # m: what counts as a radian of a prismatic joint
_ASSUMED_DRY_FRICTION = 0.05  # largest torques of a joint that shows none: sizes are judged by it
_AT_ONCE = 32  # shapes: their columns together stay small
_NYQUIST_MARGIN = 1.3  # of half of the sampling rate over the proposed cut-off of the positions
_HIGHEST_CUTOFF = 0.4  # of the sampling rate: cut-off of the positions that is proposed at most

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True)
class Baseline:
    """The refit of the nominal model to the recordings, and what candidates are made from.

    The model has torque offsets, whatever the configuration says: what is constant is a number of
    the nominal model (zero there), and no physics that it lacks. Where joints stick is known where
    the closed loop of every recording is simulated.
    """

    prepared: PreparedRegression
    estimate: IdimIvEstimate
    sources: InstrumentSources
    commands: LawCommands | None  # beside the law; None where they cannot be compared
    motions: tuple[SmoothMotion, ...]
    sticking: bool  # whether it is known where joints stick
    regression: Regression  # of the torque on the smooth motion
    shift: float = 0.0  # s by which the effort of its rows is later than recorded

    @property
    def rows(self) -> tuple[JointRows, ...]:
        """Rows of every joint: the torque, and the model on the smooth motion."""
        return self.regression.joints

    @property
    def joints(self) -> tuple[str, ...]:
        """Names, in the order of the configuration."""
        return tuple(self.prepared.configuration.robot.joints)

    @cached_property
    def recordings(self) -> tuple[IntArray, ...]:
        """(r_j,) of each joint: which recording each row belongs to."""
        return self.of_joints([np.full(len(m.kept), k) for k, m in enumerate(self.motions)])

    def on(self, motions: tuple[SmoothMotion, ...]) -> "Baseline":
        """Return the same on other motions, with friction that sticks as theirs does."""
        parts = []
        for motion in motions:
            states = motion.position, motion.velocity, motion.acceleration
            matrices = self.prepared.model.joint_matrices(*states)
            for joint, matrix in enumerate(matrices):
                matrix[:, self.columns_of(joint, "Fc")] = motion.slip[:, [joint]]
            rows = zip(map(motion.rows, matrices), motion.kept.T, strict=True)
            parts.append([matrix[kept] for matrix, kept in rows])
        joints = tuple(
            replace(row, matrix=np.concatenate([part[joint] for part in parts]), position=None)
            for joint, row in enumerate(self.rows)
        )
        return replace(self, motions=motions, regression=replace(self.regression, joints=joints))

    def later(self, shift: float) -> "Baseline":
        """Return the same with the effort of the rows `shift` seconds later than recorded."""
        torques = [torque_rows(_later(motion, shift)) for motion in self.prepared.motions]
        rows = tuple(
            replace(row, torque=np.concatenate([torque[joint] for torque in torques]))
            for joint, row in enumerate(self.rows)
        )
        return replace(self, regression=replace(self.regression, joints=rows), shift=shift)

    @property
    def left_out(self) -> frozenset[int]:
        """Joints whose torque says nothing of the robot."""
        joints = enumerate(self.rows)
        return frozenset(joint for joint, rows in joints if rows.left_out)

    @property
    def row_rate(self) -> float:
        """Rows per second."""
        return self.prepared.cutoffs.row_rate

    @property
    def torque_sizes(self) -> FloatArray:
        """RMS (n_joints,) of the recorded torque of each joint, N m (N)."""
        return np.maximum([rms(rows.torque) for rows in self.rows], 1e-300)

    @cached_property
    def covered(self) -> tuple[JointRange, ...]:
        """What the recordings cover at each joint."""
        motions, model = self.motions, self.prepared.model

        def largest(name: str) -> FloatArray:
            return np.asarray(np.max([np.abs(getattr(m, name)).max(axis=0) for m in motions], 0))

        fastest, torque = largest("velocity"), largest("torque")
        # Where rows of all speeds count, those that do are a share of the peak.
        least = settings.LEAST_SPEED_SHARE * fastest
        level = model.dynamic_parameters(self.estimate.linear.values).coulomb
        shown = level > settings.LEAST_DRY_FRICTION * torque
        kinds = model.robot.joint_types
        of_joints = {
            "low": np.min([m.position.min(axis=0) for m in motions], axis=0),
            "high": np.max([m.position.max(axis=0) for m in motions], axis=0),
            "slowest": np.maximum(self.prepared.minimum_speed, least),
            "fastest": fastest,
            "mean_speed": np.mean(np.abs(np.concatenate([m.velocity for m in motions])), axis=0),
            "load": largest("load"),
            "torque": torque,
            "dry_friction": np.where(shown, level, _ASSUMED_DRY_FRICTION * torque),
            "inertia": np.mean(
                [np.einsum("sii->i", m.inertia) / len(m.time) for m in motions], axis=0
            ),
            "lever": [1.0 if kind == "revolute" else _PRISMATIC_LEVER for kind in kinds],
        }
        return tuple(
            JointRange(
                **{name: float(values[joint]) for name, values in of_joints.items()},
                duration=float(max(m.time[-1] for m in motions)),
                longest=float(max(m.elapsed[-1] for m in motions)),
                row_rate=self.row_rate,
                sticking=self.sticking,
                left_out=joint in self.left_out,
            )
            for joint in range(len(self.joints))
        )

    def columns_of(self, joint: int, *kinds: str) -> IntArray:
        """Places of kinds of base parameters (Fc) of a joint among the columns of its rows."""
        names, wanted = self.prepared.model.base.names, {f"{kind}{joint + 1}" for kind in kinds}
        columns = self.rows[joint].columns
        return np.flatnonzero([names[column] in wanted for column in columns])

    def unit_at(self, joint: int, unit: str) -> str:
        """Translate units, also within words, from those of a joint that turns, torque in N m."""
        joint_type = self.prepared.model.robot.joint_types[joint]
        return unit_at(unit, joint_type, self.prepared.configuration.signals.effort_unit)

    def in_units_at(self, joint: int, parameters: Parameters) -> Parameters:
        """Parameters of an effect with the units that they have at a joint."""
        return {
            name: replace(parameter, unit=self.unit_at(joint, parameter.unit))
            for name, parameter in parameters.items()
        }

    def joint_change(self, joint: int, before: float, after: float) -> JointChange:
        """What takes the torque gap of a joint from `before` to `after`, N m (N)."""
        energy = float(before) ** 2 - float(after) ** 2
        share = float(np.sign(energy) * np.sqrt(abs(energy))) / self.torque_sizes[joint]
        return JointChange(self.joints[joint], float(before), float(after), share)

    def decimated(self, joint: int, values: Sequence[FloatArray]) -> FloatArray:
        """Rows of one joint (r, …) from values (s, …) on the grid of each smooth motion."""
        parts = zip(values, self.motions, strict=True)
        return self.counting(joint, [motion.rows(part) for part, motion in parts])

    def of_joints(self, values: Sequence[NDArray[T]]) -> tuple[NDArray[T], ...]:
        """Rows (r_j,) of every joint from decimated values (m,) of each recording."""
        return tuple(self.counting(joint, values) for joint in range(len(self.joints)))

    def counting(self, joint: int, values: Sequence[NDArray[T]]) -> NDArray[T]:
        """Rows of one joint (r, …) from decimated values (m, …) of each recording."""
        return np.concatenate(
            [part[motion.kept[:, joint]] for part, motion in zip(values, self.motions, strict=True)]
        )


def baseline(recordings: Sequence[Recording], configuration: Configuration) -> Baseline:
    """Refit the model by IDIM-IV, with torque offsets; errors as `identify`.

    Unless the user says how far rows keep from a reversal, they count there if, and only if, the
    closed loop could be simulated.
    """
    for section in proposals([recordings], configuration):
        refit = refit_of(prepare(recordings, section))
        if refit.sticking:
            break
    return refit


def refit_of(prepared: PreparedRegression, shift: float = 0.0) -> Baseline:
    """Refit the model to recordings that are already filtered; errors as `identify`.

    `shift`: s by which the effort is taken to be later than recorded.
    """
    configuration = prepared.configuration
    left_out = {finding.joint for finding in prepared.joint_findings if finding.left_out}
    late = [_later(motion, shift) if shift != 0.0 else motion for motion in prepared.motions]
    rows = tuple(
        replace(row, left_out=joint in left_out)
        for joint, row in enumerate(observation_rows(prepared.model, late))
    )
    require_excitation(prepared, rows)
    sources, commands = with_law_speed(
        instrument_sources(configuration, prepared.model, prepared.motions, prepared.cutoffs)
    )
    estimate = idim_iv(
        rows,
        sources.sources,
        sources.starts,
        tolerance=configuration.identification.tolerance,
        max_iterations=configuration.identification.max_iterations,
    )
    motions, sticking = smooth_motions(prepared, estimate)
    measured = Regression(rows, len(prepared.model.base.columns))
    made = Baseline(prepared, estimate, sources, commands, motions, sticking, measured, shift)
    return made.on(motions)


def _later(motion: Motion, shift: float) -> Motion:
    signals = motion.signals
    effort = shifted(signals.torque, shift, signals.rate)
    return replace(motion, signals=replace(signals, torque=effort))


def with_parameters(data: Baseline, values: FloatArray) -> Baseline:
    """Return the same motions with the torques of other base parameters (b,)."""
    links, whole = dynamics_of(data.prepared, values)
    motions = tuple(replace(motion, links=links, whole=whole) for motion in data.motions)
    return replace(data, motions=motions)


def nominal_residuals(data: Baseline) -> tuple[FloatArray, ...] | None:
    """Measured torque less that of the nominal model: (r_j,) N m (N) of each joint."""
    given = data.prepared.given
    return None if given is None else tuple(rows.residual(given) for rows in data.rows)


def rows_of(
    data: Baseline,
    effect: Effect,
    place: Place,
    shapes: Sequence[Shape],
    precision: type[np.floating] = np.float64,
) -> list[Columns]:
    """Rows of the regression for each shape; many shapes are decimated at once.

    Columns of shapes that follow each other lie one after the other in memory. `precision`: of
    what is decimated; that of a catalogue, which is compared and not differentiated, is single.
    """
    made: list[dict[int, FloatArray]] = [{} for _ in shapes]
    for start in range(0, len(shapes), _AT_ONCE):
        some, tables = shapes[start : start + _AT_ONCE], []
        for motion in data.motions:
            torques = effect.torques(motion, place, some)
            joints, ends = tuple(torques[0]), np.cumsum([width_of(torque) for torque in torques])
            parts = [torque[joint].T for joint in joints for torque in torques]
            with np.errstate(over="ignore"):  # shapes beyond all hardware are no candidates
                lines = np.concatenate(parts, dtype=precision, casting="same_kind")
            del torques, parts  # before the lines are filtered
            tables.append(motion.rows(lines.T).T)
        for number, joint in enumerate(joints):
            of_joint = slice(number * ends[-1], (number + 1) * ends[-1])
            counting = [
                table[of_joint].compress(motion.kept[:, joint], axis=1)
                for table, motion in zip(tables, data.motions, strict=True)
            ]
            shares = np.split(np.concatenate(counting, axis=1), ends[:-1])
            for columns, lines in zip(made[start:], shares, strict=False):
                columns[joint] = lines.T
    return list(made)


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
    measured = rate
    for recording in recordings:  # efforts of a slower topic are interpolated to the grid
        topic = recording.effort.origin.rpartition(" ")[0]
        clocks = [clock.rate for clock in recording.clocks if clock.topic == topic]
        measured = min(measured, *(clocks[:1] or [recording.rate]))
    sampled = measured / (2.0 * settings.POSITION_OVER_DECIMATION * _NYQUIST_MARGIN)
    noise = settings.ACCELERATION_NOISE if simulated else settings.MEASURED_NOISE
    rows = observation_rows(prepared.model, prepared.motions)
    require_excitation(prepared, rows)
    values = solve_least_squares(rows, len(prepared.model.base.columns)).values
    parameters = prepared.model.dynamic_parameters(values)
    positions = prepared.motions[0].position
    inertia = np.abs(joint_inertia(prepared.model.robot, parameters, positions))
    ratio = _noise(prepared.motions, "torque") / np.maximum(
        inertia * _noise(prepared.motions, "position"), 1e-30
    )
    # Where accelerations add `noise` times the torque's, the least over the joints.
    limit = float(np.sqrt(np.sqrt(5.0) * noise * ratio.min())) / (2.0 * np.pi)
    cutoff = min(limit, settings.WIDEST_BAND, sampled)
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


def _noise(motions: Sequence[Motion], quantity: str) -> FloatArray:
    """Standard deviation (n_joints,) of the noise in single samples: the upper half of the band."""
    variances = []
    for motion in motions:
        values, rate = getattr(motion.signals, quantity), motion.signals.rate
        variances.append(noise_density(values, rate, 0.25 * rate) * rate / 2.0)
    return np.asarray(np.sqrt(np.mean(variances, axis=0)))
