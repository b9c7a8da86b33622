"""Where the instruments come from: a simulated closed loop, or what replaces it.

Equation 8 asks for a simulation with the same references and the same control law. Where the
references or the law are missing, `sources` says what takes their place at what cost.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ClassVar

import numpy as np

from idim_iv_ros.estimation.observation import States, instrument_rows
from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import ControlLaw, inverse_dynamics, joint_inertia
from idim_iv_ros.simulation.closed_loop import replay
from idim_iv_ros.types import FloatArray

# Gains are rescaled only while the simulated inertia is further than this from the robot's.
_SAME_INERTIA = 0.25
# Simulations at perturbed parameters that tell how far their uncertainty moves the instruments.
_DRAWS = 6
_THREADS = 2
_SEED = 1948


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
    states = tuple(
        partial(motion.derivatives_of, position)
        for position, motion in zip(positions, motions, strict=True)
    )
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
        scale = self._gain_scale(values, reference_values)
        note = ""
        if not np.allclose(scale, 1.0):
            note = "gains scaled by " + ", ".join(f"{factor:.3g}" for factor in scale)
        return _instruments(self.model, self.motions, self._positions(values, scale), note)

    def prediction_errors(
        self, values: FloatArray, covariance: FloatArray
    ) -> tuple[FloatArray, ...] | None:
        """Change of Z β̂ when the simulation runs at parameters as uncertain as `values` are.

        The instruments are simulated with estimated parameters; a difference between X β̂ and
        Z β̂ of this size says nothing against the model.

        `values`, `covariance`: (b,) estimate and (b, b) covariance, that of the measurement noise
        alone: a model error inflates the residual, and would otherwise hide itself.

        Returns one (r_j, n_draws) array for each joint, N m, without draws that diverge; None if
        the simulation at `values` itself diverges.
        """
        random = np.random.default_rng(_SEED)
        root = np.linalg.cholesky(covariance + 1e-12 * np.diag(np.diag(covariance)))
        no_scale = np.ones(len(self.motions[0].position[0]))
        drawn = values + random.standard_normal((_DRAWS, len(values))) @ root.T

        def predictions(at: FloatArray) -> list[FloatArray] | None:
            try:
                return self._predictions(at, values, no_scale)
            except SourceFailure:
                return None

        with ThreadPoolExecutor(_THREADS) as pool:  # the compiled simulation frees the lock
            nominal, *moved = pool.map(predictions, [values, *drawn])
        if nominal is None:
            return None
        errors = [
            [a - b for a, b in zip(prediction, nominal, strict=True)]
            for prediction in moved
            if prediction is not None
        ]
        if not errors:
            return tuple(np.zeros((len(joint), 0)) for joint in nominal)
        return tuple(np.column_stack(joint) for joint in zip(*errors, strict=True))

    def natural_frequency(self, values: FloatArray) -> float:
        """Highest natural frequency of the loops, √(kp / J) of each joint, Hz."""
        inertia = self._joint_inertia(values)
        stiffness = np.max([law.kp for law in self.laws], axis=0)
        usable = inertia > 0.0
        if not usable.any():
            return 0.0
        return float(np.sqrt(np.max(stiffness[usable] / inertia[usable]))) / (2.0 * np.pi)

    def _predictions(
        self, values: FloatArray, predicting: FloatArray, scale: FloatArray
    ) -> list[FloatArray]:
        """Torque rows of each joint, with `predicting`, on the motion simulated at `values`."""
        parameters = self.model.dynamic_parameters(predicting)
        parts = []
        for position, motion in zip(self._positions(values, scale), self.motions, strict=True):
            samples = motion.span.stop - motion.span.start
            states = motion.derivatives_of(position, 0, samples)
            torque = inverse_dynamics(self.model.robot, parameters, *states)
            decimated = motion.decimation.whole(torque)
            parts.append([decimated[kept, j] for j, kept in enumerate(motion.kept.T)])
        return [np.concatenate(joint) for joint in zip(*parts, strict=True)]

    def _positions(self, values: FloatArray, scale: FloatArray) -> list[FloatArray]:
        """Simulated and filtered positions of every recording."""
        parameters = self.model.dynamic_parameters(values)
        positions = []
        for motion, law in zip(self.motions, self.laws, strict=True):
            result = replay(
                self.model.robot, parameters, law.scaled(scale), motion, accelerations=False
            )
            if result.diverged is not None:
                raise SourceFailure(f"{motion.signals.name}: {result.diverged}")
            positions.append(motion.filtered(result.position))
        return positions

    def _joint_inertia(self, values: FloatArray) -> FloatArray:
        """(n_joints,) kg m² (kg), over a few positions."""
        parameters = self.model.dynamic_parameters(values)
        return joint_inertia(self.model.robot, parameters, self.motions[0].position)

    def _gain_scale(self, values: FloatArray, reference_values: FloatArray) -> FloatArray:
        """J_j(values) / J_j(robot), 1 where they are close."""
        simulated = self._joint_inertia(values)
        actual = self._joint_inertia(reference_values)
        usable = (simulated > 0.0) & (actual > 0.0)
        ratio = np.where(usable, simulated / np.where(usable, actual, 1.0), 1.0)
        return np.where(np.abs(ratio - 1.0) > _SAME_INERTIA, ratio, 1.0)


@dataclass(frozen=True)
class FixedMotion:
    """Instruments from positions that do not depend on the parameters.

    `make` returns positions (n_samples, n_joints) for every motion and says what they are; it is
    called when they are needed, which a loop that simulates spares.
    """

    model: InverseModel
    motions: tuple[Motion, ...]
    make: Callable[[Sequence[Motion]], tuple[list[FloatArray], str]]
    untestable: str

    iterative: ClassVar[bool] = False

    @cached_property
    def _made(self) -> tuple[list[FloatArray], str]:
        return self.make(self.motions)

    @property
    def name(self) -> str:
        """Which positions the instruments are made of, in words for the report."""
        return self._made[1]

    def prediction_errors(self, values: FloatArray, covariance: FloatArray) -> None:
        """None: nothing is simulated at the parameters."""

    def instruments(self, values: FloatArray, reference_values: FloatArray) -> Instruments:
        """Instruments from the differentiated positions, the same at any parameters."""
        return _instruments(self.model, self.motions, self._made[0])


# `untestable`: why tests of the instruments mean nothing; None where they mean something.
# `iterative`: whether the instruments depend on the parameters.
InstrumentSource = SimulatedLoop | FixedMotion
