"""Where the instruments come from: a simulated closed loop, or what a recording allows instead.

Equation 8 asks for a simulation with the same references and the same control law. Where the
references or the law are missing, other motions take their place at a cost that is said.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.estimation.observation import States, instrument_rows
from idim_iv_ros.model import InverseModel, RobotModel
from idim_iv_ros.signals.cutoffs import Cutoffs
from idim_iv_ros.signals.filters import zero_phase_butterworth
from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.simulation import (
    ControlLaw,
    ControllerFit,
    control_law,
    control_period,
    filter_reference,
    fit_controller,
    inverse_dynamics,
    joint_inertia,
)
from idim_iv_ros.simulation.closed_loop import replay
from idim_iv_ros.types import FloatArray

# Gains are rescaled only while the simulated inertia is further than this from the robot's.
_SAME_INERTIA = 0.25
# Simulations at perturbed parameters that tell how far their uncertainty moves the instruments.
_DRAWS = 6
_THREADS = 2
_SEED = 1948
# A fitted control law that explains less of the torque than this is not simulated.
LEAST_R_SQUARED = 0.9


class SourceFailure(Exception):
    """A source cannot make instruments; the message says why."""


@dataclass(frozen=True)
class Instruments:
    """Instruments with which an iteration of IDIM-IV solves, and how they were made.

    - `states`: of each motion, simulated q, dq, ddq of the span
    - `note`: what was done to obtain them, in words; empty when there is nothing to say
    - `untestable`: why a difference between simulated and measured motion says nothing of the model
    """

    matrices: tuple[FloatArray, ...]
    states: tuple[States, ...]
    note: str = ""
    untestable: str | None = None


def _instruments(
    model: InverseModel, motions: Sequence[Motion], positions: Sequence[FloatArray], note: str = ""
) -> Instruments:
    """Instruments from filtered positions (n_samples, n_joints) of all motions."""
    pairs = zip(positions, motions, strict=True)
    states = tuple(partial(motion.derivatives_of, position) for position, motion in pairs)
    return Instruments(instrument_rows(model, motions, states), states, note)


@dataclass(frozen=True)
class SimulatedLoop:
    """Instruments from the simulated closed loop (equations 7 and 8).

    `motions`: all with references; `laws`: one for each motion.
    """

    model: InverseModel
    motions: tuple[Motion, ...]
    laws: tuple[ControlLaw, ...]
    name: str = "closed-loop simulation with the configured control law"

    iterative: ClassVar[bool] = True
    untestable: ClassVar[str | None] = None  # the instruments do not use the measurements

    def instruments(self, values: FloatArray, reference_values: FloatArray) -> Instruments:
        """Simulate every recording at `values`; gains keep the bandwidth of the real loop.

        The simulated positions go through the position filter of the regressor, so that X and Z
        differ by noise and by the model, not by the filter.
        """
        simulated, actual = map(self._joint_inertia, (values, reference_values))
        usable = (simulated > 0.0) & (actual > 0.0)
        ratio = np.where(usable, simulated / np.where(usable, actual, 1.0), 1.0)
        scale = np.where(np.abs(ratio - 1.0) > _SAME_INERTIA, ratio, 1.0)
        note = ""
        if not np.allclose(scale, 1.0):
            note = "gains scaled by " + ", ".join(f"{factor:.3g}" for factor in scale)
        return _instruments(self.model, self.motions, self._positions(values, scale), note)

    def prediction_errors(
        self, values: FloatArray, covariance: FloatArray
    ) -> tuple[FloatArray, ...] | None:
        """Change of Z β̂ when the simulation runs at parameters as uncertain as `values` are.

        A difference between X β̂ and Z β̂ of this size says nothing against the model. `covariance`
        (b, b) of `values` (b,) is that of the measurement noise alone: a model error inflates the
        residual, and would otherwise hide itself.

        Returns one (r_j, n_draws) array for each joint, N m, without draws that diverge; None if
        the simulation at `values` itself diverges.
        """
        random = np.random.default_rng(_SEED)
        root = np.linalg.cholesky(covariance + 1e-12 * np.diag(np.diag(covariance)))
        drawn = values + random.standard_normal((_DRAWS, len(values))) @ root.T
        predicting = self.model.dynamic_parameters(values)
        no_scale = np.ones(len(self.motions[0].position[0]))

        def predictions(at: FloatArray) -> list[FloatArray] | None:
            """Torque rows of each joint, at `values`, on the motion simulated `at` others."""
            try:
                positions = self._positions(at, no_scale)
            except SourceFailure:
                return None
            parts = []
            for position, motion in zip(positions, self.motions, strict=True):
                states = motion.derivatives_of(position, 0, motion.span.stop - motion.span.start)
                torque = inverse_dynamics(self.model.robot, predicting, *states)
                decimated = motion.decimation.whole(torque)
                parts.append([decimated[kept, j] for j, kept in enumerate(motion.kept.T)])
            return [np.concatenate(joint) for joint in zip(*parts, strict=True)]

        with ThreadPoolExecutor(_THREADS) as pool:  # the compiled simulation frees the lock
            nominal, *moved = pool.map(predictions, [values, *drawn])
        if nominal is None:
            return None
        usable = [prediction for prediction in moved if prediction is not None]
        return tuple(
            np.array([of[k] - joint for of in usable]).reshape(len(usable), len(joint)).T
            for k, joint in enumerate(nominal)
        )

    def natural_frequency(self, values: FloatArray) -> float:
        """Highest natural frequency of the loops, √(kp / J) of each joint, Hz."""
        inertia = self._joint_inertia(values)
        usable = inertia > 0.0
        stiffness = np.max([law.kp for law in self.laws], axis=0)
        squares = stiffness[usable] / inertia[usable]
        return float(np.sqrt(np.max(squares, initial=0.0))) / (2.0 * np.pi)

    def _positions(self, values: FloatArray, scale: FloatArray) -> list[FloatArray]:
        robot, parameters = self.model.robot, self.model.dynamic_parameters(values)
        positions = []
        for motion, law in zip(self.motions, self.laws, strict=True):
            result = replay(robot, parameters, law.scaled(scale), motion, accelerations=False)
            if result.diverged is not None:
                raise SourceFailure(f"{motion.signals.name}: {result.diverged}")
            positions.append(motion.filtered(result.position))
        return positions

    def _joint_inertia(self, values: FloatArray) -> FloatArray:
        """(n_joints,) kg m² (kg), over a few positions."""
        parameters = self.model.dynamic_parameters(values)
        return joint_inertia(self.model.robot, parameters, self.motions[0].position)


@dataclass(frozen=True)
class FixedMotion:
    """Instruments from positions that do not depend on the parameters.

    `make` returns positions (n_samples, n_joints) for every motion and says what they are; it is
    called when they are needed, which a loop that simulates spares.
    """

    model: InverseModel
    motions: tuple[Motion, ...]
    make: Callable[[], tuple[list[FloatArray], str]]
    untestable: str

    iterative: ClassVar[bool] = False

    @cached_property
    def _made(self) -> tuple[list[FloatArray], str]:
        return self.make()

    @property
    def name(self) -> str:
        """Which positions the instruments are made of, in words for the report."""
        return self._made[1]

    def instruments(self, values: FloatArray, reference_values: FloatArray) -> Instruments:
        """Instruments from the differentiated positions, the same at any parameters."""
        return _instruments(self.model, self.motions, self._made[0])


# `untestable`: why tests of the instruments mean nothing; None where they mean something.
# `iterative`: whether the instruments depend on the parameters.
InstrumentSource = SimulatedLoop | FixedMotion


@dataclass(frozen=True)
class Start:
    """Base parameters (b,) of a possible first simulation.

    `spread` (b,): size of each given value, infinite where none is given; None where the values
    are not meant to be the robot's, so that its gains need not suit them.
    """

    name: str
    values: FloatArray
    spread: FloatArray | None


def _filtered_references(
    robot: RobotModel, motions: Sequence[Motion]
) -> tuple[list[FloatArray], str]:
    """References through a fitted closed-loop filter, and how closely they follow the motion."""
    filters = [
        filter_reference(motion.signals.rate, motion.position, motion.signals.position_reference)
        for motion in motions
        if motion.signals.position_reference is not None
    ]
    positions, missed, moved = zip(*filters, strict=True)
    errors, spreads = np.max(missed, axis=0), np.max(moved, axis=0)
    parts = zip(robot.joints, robot.joint_types, errors, spreads, strict=True)
    joints = ", ".join(
        f"{name} {error:.2g} {'rad' if kind == 'revolute' else 'm'}"
        + (f" ({100.0 * error / spread:.2g} %)" if spread > 0.0 else "")
        for name, kind, error, spread in parts
    )
    return list(positions), (
        "reference through a fitted closed-loop filter, which misses the recorded motion where "
        f"it was not fitted by (rms, and share of the motion's standard deviation): {joints}"
    )


def _smoothed_measurements(
    cutoff: float, motions: Sequence[Motion]
) -> tuple[list[FloatArray], str]:
    """Positions smoothed harder than the regressor's.

    Noise below the cut-off stays in both X and Z: the estimate keeps the bias of least squares.
    """
    return [
        zero_phase_butterworth(motion.position, rate=motion.signals.rate, cutoff=cutoff, order=4)
        for motion in motions
    ], f"measured positions smoothed at {cutoff:.3g} Hz"


@dataclass(frozen=True)
class InstrumentSources:
    """Sources in the order in which they are tried, and where the iteration may start.

    `controller`: what is known of the control law, one sentence each; `fits`: one for each motion
    where the law is unknown.
    """

    sources: tuple[InstrumentSource, ...]
    starts: tuple[Start, ...]
    controller: tuple[str, ...]
    fits: tuple[ControllerFit, ...] = ()


def instrument_sources(
    configuration: Configuration, model: InverseModel, motions: Sequence[Motion], cutoffs: Cutoffs
) -> InstrumentSources:
    """List the sources of instruments that the configuration and the recordings allow."""
    sources: list[InstrumentSource] = []
    fits: tuple[ControllerFit, ...] = ()
    missing = [m.signals.name for m in motions if m.signals.position_reference is None]
    if not missing:
        law, fits, sentences = _laws(configuration, motions)
        if law is not None:
            how = "fitted" if configuration.controller.type == "unknown" else "configured"
            name = f"closed-loop simulation with the {how} control law"
            sources.append(SimulatedLoop(model, tuple(motions), law, name))
        untestable = (
            "the instruments come from a filter that was fitted to the measured motion: it follows "
            "the robot whatever the dynamic model is"
        )
        make = partial(_filtered_references, model.robot, motions)
        sources.append(FixedMotion(model, tuple(motions), make, untestable))
    else:
        sentences = [
            f"no reference is read from {', '.join(missing)}: the closed loop cannot be simulated, "
            "so that the instruments are smoothed measurements. Noise of the positions below the "
            "smoothing frequency is not averaged out, and the instruments cannot be tested"
        ]
    cutoff = cutoffs.decimation / 2.0
    untestable = (
        "the instruments are smoothed measurements, not a simulation: the noise below "
        f"{cutoff:.3g} Hz is in both"
    )
    smooth = partial(_smoothed_measurements, cutoff, motions)
    sources.append(FixedMotion(model, tuple(motions), smooth, untestable))
    return InstrumentSources(tuple(sources), _starts(configuration, model), tuple(sentences), fits)


def _starts(configuration: Configuration, model: InverseModel) -> tuple[Start, ...]:
    """Values with which the iteration may begin: the nominal ones, if usable, then regular ones."""
    regular = Start("the regular start", model.regular, spread=None)
    usable = model.robot.has_inertials and configuration.signals.effort_unit == "N m"
    if configuration.identification.start == "regular" or not usable:
        return (regular,)
    # A servo's law has no damping of its own: without the friction its loop would run away.
    servo = configuration.signals.effort_topic is None
    values = model.given if servo else model.given_without_friction
    given = Start("the given values", values, _sizes(model))
    return (given, regular)


def _sizes(model: InverseModel) -> FloatArray:
    """Size of each given value (b,): its own and the median of its unit; infinite for friction."""
    values, units = np.abs(model.given_without_friction), np.array(model.base.units)
    sizes = np.full(len(values), np.inf)
    for same in (units == unit for unit in set(model.base.units)):
        if values[same].any():
            sizes[same] = values[same] + np.median(values[same & (values > 0.0)])
    return sizes


def _laws(
    configuration: Configuration, motions: Sequence[Motion]
) -> tuple[tuple[ControlLaw, ...] | None, tuple[ControllerFit, ...], list[str]]:
    section = configuration.controller
    joints = configuration.robot.joints
    if section.type != "unknown":
        law = control_law(section, len(joints))
        law = replace(law, period=control_period(section, (m.signals.rate for m in motions)))
        return tuple(law for _ in motions), (), [f"control law {section.type} as configured"]
    limit = section.torque_limit
    fits = tuple(fit_controller(motion.signals, torque_limit=limit) for motion in motions)
    sentences = [
        f"{name}{f' in {motion.signals.name}' if len(motions) > 1 else ''}: {fit.describe(joint)}"
        for fit, motion in zip(fits, motions, strict=True)
        for joint, name in enumerate(joints)
    ]
    worst = min(float(fit.r_squared.min()) for fit in fits)
    if worst < LEAST_R_SQUARED:
        why = (
            f"the fitted control law explains only R² = {worst:.2f} of a joint's torque, less than "
            f"{LEAST_R_SQUARED:g}: the loop is not simulated with it"
        )
        return None, fits, [*sentences, why]
    pairs = zip(fits, motions, strict=True)
    try:
        laws = tuple(fit.law(motion.signals, limit) for fit, motion in pairs)
    except ValueError as error:
        why = f"the loop is not simulated with the fitted control law: {error}"
        return None, fits, [*sentences, why]
    return laws, fits, sentences
