"""The motion on which candidate torques are computed: little noise, and close to the robot's.

The simulated motion has no noise but misses what the model lacks; the measured motion has both.
Here the measured one counts below a few hertz and the simulated one above: derivatives up to the
fourth then carry almost no noise of the encoders, and friction changes sign when the robot turned.

At a reversal an ideal dry friction does not jump: the joint rests while the torque that holds it
crosses from one level to the other. A model with the sign of the speed is wrong there by as much
as the friction, for tens of milliseconds, and filters smear that over the rows around.

The simulated loop differs from the robot's by what nobody configured: periods of computing, the
filter of its speed, the drive. A percent that its motion lacks near the upper end of the band is a
percent of the inertial torque there, the same at all joints, and looks like a soft shaft or a slow
drive. The difference of the two motions is a linear function of the simulated one, as far as the
loops are linear: its coefficients are fitted where both are seen, and noise of the encoders, which
the simulated motion does not have, does not bias them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.effects.motion import RobotMotion
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.model import DynamicParameters
from idim_iv_ros.signals.decimation import ParallelDecimation
from idim_iv_ros.signals.filters import zero_phase_butterworth
from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.simulation import inverse_dynamics, mass_matrix
from idim_iv_ros.simulation.closed_loop import replay
from idim_iv_ros.types import FloatArray

_SLOPE_STEP = 1e-5  # rad or m

_JOINING_ORDER = 2  # of the filter that joins measured and simulated motion
_ROWS_PER_COEFFICIENT = 15  # with fewer, only the motion of the joint alone is fitted
_DERIVATIVES = 3  # of the simulated motion: as it is, and its first and second derivative

States = Sequence[FloatArray]


def high_passed(signal: FloatArray, rate: float, cutoff: float) -> FloatArray:
    """Return what of a signal (s, n_joints) lies above the frequency where the motions join."""
    below = settings.MEASURED_BELOW * cutoff
    return signal - zero_phase_butterworth(signal, rate=rate, cutoff=below, order=_JOINING_ORDER)


def corrected_motions(
    motions: Sequence[Motion],
    measured: Sequence[States],
    simulated: Sequence[States],
    cutoff: float,
) -> list[list[FloatArray]]:
    """Simulated q, dq, ddq of each recording with what they miss of the measured ones.

    m̈_j − s̈_j = Σ_k Σ_d c_jkd dᵈs̈_k/dtᵈ, d = 0, 1, 2, by least squares over the rows of all
    recordings, of what lies above the frequency where the motions join. All joints k count where
    there are rows enough, else joint j alone.

    `measured`, `simulated`: q, dq, ddq (s, n_joints) on the span of each of the `motions`;
    `cutoff`: of their decimation, Hz.
    """
    if not motions:
        return []
    derived, rows, targets = [], [], []
    for motion, real, states in zip(motions, measured, map(list, simulated), strict=True):
        decimation, rate = motion.decimation, motion.signals.rate
        for _ in range(_DERIVATIVES - 1):  # position first, up to its fourth derivative
            states.append(np.gradient(states[-1], 1.0 / rate, axis=0))
        derived.append(states)
        columns = [decimation.whole(high_passed(state, rate, cutoff)) for state in states[2:]]
        rows.append(np.stack(columns, axis=2))  # (m, n_joints, derivatives)
        targets.append(decimation.whole(high_passed(real[2] - states[2], rate, cutoff)))
    tables, differences = np.concatenate(rows), np.concatenate(targets)
    count, joints, _ = tables.shape
    coefficients = np.zeros((joints, joints, _DERIVATIVES))
    every = count >= _ROWS_PER_COEFFICIENT * joints * _DERIVATIVES
    for joint in range(joints):
        used = np.arange(joints) if every else np.array([joint])
        table = tables[:, used].reshape(count, -1)
        scale = np.linalg.norm(table, axis=0)
        scale[scale == 0.0] = 1.0
        solution = np.linalg.lstsq(table / scale, differences[:, joint], rcond=1e-6)[0] / scale
        coefficients[joint, used] = solution.reshape(len(used), _DERIVATIVES)
    return [
        [
            states[order]
            + sum(states[order + d] @ coefficients[:, :, d].T for d in range(_DERIVATIVES))
            for order in range(3)
        ]
        for states in derived
    ]


def simulated_slips(
    prepared: PreparedRegression, estimate: IdimIvEstimate
) -> tuple[FloatArray | None, ...]:
    """Friction of each recording's span as a share of its level, (n_samples, n_joints), −1 to 1.

    None where the closed loop is not simulated.
    """
    source = estimate.source
    if not isinstance(source, SimulatedLoop):
        return (None,) * len(prepared.motions)
    robot = source.model.robot
    parameters = source.model.dynamic_parameters(estimate.linear.values)
    level = np.maximum(parameters.coulomb, 0.0)
    slips: list[FloatArray | None] = []
    for motion, law in zip(source.motions, source.laws, strict=True):
        run = replay(robot, parameters, law, motion)
        if run.diverged is not None:
            slips.append(None)
            continue
        states = run.position, run.velocity, run.acceleration
        slippery = inverse_dynamics(robot, parameters.without_dry_friction, *states)
        share = (run.applied_torque - slippery) / np.where(level > 0.0, level, 1.0)
        sticking = (run.velocity == 0.0) & (level > 0.0)
        slip = np.where(sticking, np.clip(share, -1.0, 1.0), np.sign(run.velocity))
        slips.append(np.asarray(slip[motion.span]))
    return tuple(slips)


@dataclass(frozen=True)
class SmoothMotion(RobotMotion):
    """One recording's motion on a grid between that of the samples and that of the rows.

    `whole`: dynamics of the refit with drives and friction; `slip`: the sign of the speed, and
    between while the simulated joint sticks; `decimation`: from this grid to the rows of the
    regression, of which those `kept` (m, n_joints) count.
    """

    whole: DynamicParameters
    decimation: ParallelDecimation
    kept: NDArray[np.bool_]

    @cached_property
    def load(self) -> FloatArray:
        """(s, n_joints) N m: torque of the links alone, without drives and friction."""
        return self._torque(self.links)

    @cached_property
    def static_load(self) -> FloatArray:
        """(s, n_joints) N m: `load` without accelerations: gravity and Coriolis."""
        still = np.zeros_like(self.acceleration)
        return inverse_dynamics(self.robot, self.links, self.position, self.velocity, still)

    @cached_property
    def torque(self) -> FloatArray:
        """(s, n_joints) N m: torque of the refit, its dry friction as it sticks and slips."""
        return self._torque(self.whole.without_dry_friction) + self.whole.coulomb * self.slip

    @cached_property
    def _torque_of_whole(self) -> FloatArray:
        """(s, n_joints) N m: of everything, its dry friction with the sign of the speed."""
        return self._torque(self.whole)

    @cached_property
    def inertia(self) -> FloatArray:
        """(s, n_joints, n_joints) kg m²: mass matrix of the links, each entry in one piece."""
        return np.asfortranarray(mass_matrix(self.robot, self.links, self.position))

    def slope(self, joint: int) -> FloatArray:
        """(s, n_joints) N m/rad: change of the links' torques as a joint's position moves."""
        if joint not in self._slopes:
            step = np.full(len(self.time), _SLOPE_STEP)
            slope = self.moved(joint, step, links=True) / _SLOPE_STEP
            self._slopes[joint] = np.asfortranarray(slope)
        return self._slopes[joint]

    @cached_property
    def _slopes(self) -> dict[int, FloatArray]:
        return {}

    def moved(self, joint: int, shift: FloatArray, *, links: bool) -> FloatArray:
        """Change of all torques (s, n_joints) when a joint moves by a small `shift` (s,) rad.

        `links`: of the links alone (what is behind the shaft), else of everything.
        """
        states = self.position.copy(), self.velocity.copy(), self.acceleration.copy()
        rate = np.gradient(shift, 1.0 / self.rate)
        changes = shift, rate, np.gradient(rate, 1.0 / self.rate)
        for state, change in zip(states, changes, strict=True):
            state[:, joint] += change
        moved = inverse_dynamics(self.robot, self.links if links else self.whole, *states)
        return moved - (self.load if links else self._torque_of_whole)

    def rows(self, values: FloatArray) -> FloatArray:
        """Decimate values (s, …) of this grid to all rows (m, …), counting or not."""
        return self.decimation.whole(values)

    def _torque(self, parameters: DynamicParameters) -> FloatArray:
        states = self.position, self.velocity, self.acceleration
        return inverse_dynamics(self.robot, parameters, *states)


def dynamics_of(
    prepared: PreparedRegression, values: FloatArray
) -> tuple[DynamicParameters, DynamicParameters]:
    """Dynamics of the links alone and of everything.

    Where the drive inertia is grouped into a link's, the given one is taken out of it, if its
    unit is that of the estimates.
    """
    model = prepared.model
    whole, given = model.dynamic_parameters(values), model.robot.given.drive_inertia
    grouped = np.array([f"Ia{joint + 1}" not in model.base.names for joint in range(len(given))])
    in_unit = prepared.configuration.signals.effort_unit == "N m"
    return replace(whole.of_links, drive_inertia=np.where(grouped & in_unit, -given, 0.0)), whole


def smooth_motions(
    prepared: PreparedRegression, estimate: IdimIvEstimate
) -> tuple[tuple[SmoothMotion, ...], bool]:
    """Join measured and simulated motion, one for each recording; whether all are simulated.

    What stands in for a simulated motion where there is none lacks the upper part of the band: with
    it an acceleration at 0.7 of the cut-off would be a quarter too small, as behind a soft shaft.
    """
    motions, cutoff = prepared.motions, prepared.cutoffs.decimation
    links, whole = dynamics_of(prepared, estimate.linear.values)
    slips, made = simulated_slips(prepared, estimate), []
    joined: list[States] = [motion.derivatives(0, motion.decimation.samples) for motion in motions]
    simulated = [number for number, slip in enumerate(slips) if slip is not None]
    states_of = estimate.instruments.states
    corrected = corrected_motions(
        [motions[k] for k in simulated],
        [joined[k] for k in simulated],
        [states_of[k](0, motions[k].decimation.samples) for k in simulated],
        cutoff,
    )
    for k, likely in zip(simulated, corrected, strict=True):
        joined[k] = [
            real - high_passed(real - state, motions[k].signals.rate, cutoff)
            for real, state in zip(joined[k], likely, strict=True)
        ]
    parts = zip(motions, prepared.session.parts, joined, slips, strict=True)
    for motion, part, states, slip in parts:
        decimation, stride = motion.decimation, _stride(motion.decimation.factor)
        rate, grid = motion.signals.rate, _grid(motion)
        time = part.start + (motion.span.start + np.arange(decimation.samples)[grid]) / rate
        # The mean over the samples of the coarser grid keeps when a joint turned.
        turning = np.sign(states[1]) if slip is None else slip
        turning = uniform_filter1d(turning, stride, axis=0, mode="nearest")
        made.append(
            SmoothMotion(
                robot=prepared.model.robot,
                links=links,
                whole=whole,
                rate=rate / stride,
                start=part.start,
                time=time,
                position=states[0][grid].copy(),  # not a view of all samples
                velocity=states[1][grid].copy(),
                acceleration=states[2][grid].copy(),
                slip=turning[grid],
                decimation=ParallelDecimation(
                    decimation.factor // stride, len(time), decimation.edge
                ),
                kept=motion.kept,
            )
        )
    return tuple(made), len(simulated) == len(motions)


def measured_motion(smooth: SmoothMotion, motion: Motion) -> SmoothMotion:
    """Return the smooth motion with the measured one in its whole band."""
    states = motion.derivatives(0, motion.decimation.samples)
    position, velocity, acceleration = (values[_grid(motion)] for values in states)
    return replace(smooth, position=position, velocity=velocity, acceleration=acceleration)


def _grid(motion: Motion) -> slice:
    """Samples of the span on the grid of the smooth motion."""
    kept, factor = motion.decimation.kept, motion.decimation.factor
    return slice(int(kept[0]), int(kept[-1]) + 1 + factor // 2, _stride(factor))


def _stride(factor: int) -> int:
    """Largest divisor of the decimation factor that leaves enough samples for each row."""
    most = max(factor // settings.SAMPLES_PER_ROW, 1)
    return next(stride for stride in range(most, 0, -1) if factor % stride == 0)
