"""A control law and its references in the closed loop with a MuJoCo model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from idim_iv_ros.effects.registry import name_of
from idim_iv_ros.model import DynamicParameters
from idim_iv_ros.simulation import ControlLaw, SimulatedEffect
from idim_iv_ros.simulation.affected_robot import (
    JointContributions,
    LawParts,
    changed_law,
    contributions_of,
)
from idim_iv_ros.simulation.effects import joint_effects
from idim_iv_ros.simulators.mujoco import Effects
from idim_iv_ros.simulators.mujoco_parts import StepTooLongError
from idim_iv_ros.simulators.mujoco_plant import REPLAY
from idim_iv_ros.types import FloatArray

# Longest step when nothing asks for a shorter one, s, and how often it is halved for a shaft.
LONGEST_STEP = 0.5e-3
_HALVINGS = 6
_FASTEST = 1e3  # rad/s (m/s): beyond it the simulation has diverged


@dataclass(frozen=True)
class References:
    """What one recording asked for, and where its robot began."""

    rate: float  # Hz
    position: FloatArray  # (n_samples, n_joints) rad (m)
    # (n_samples, n_joints): central differences of the positions where none was recorded
    velocity: FloatArray
    # start, speed: (n_joints,): position and velocity at the first sample, as the encoders show
    # them
    start: FloatArray
    speed: FloatArray
    start_time: float  # s since the start of the session


@dataclass(frozen=True)
class MujocoMotion:
    """What a recorder would have seen, (n_samples, n_joints) each."""

    position: FloatArray  # rad (m): of the encoders
    torque: FloatArray  # N m (N): command of the law
    diverged: str = ""  # Why it ended early; empty if it did not


def run_in_mujoco(
    mujoco: Any,
    model: Any,
    joints: Sequence[str],
    law: ControlLaw,
    references: References,
    parameters: DynamicParameters,
    effects: Sequence[SimulatedEffect] = (),
    *,
    longest_step: float = LONGEST_STEP,
) -> MujocoMotion:
    """Follow references with a control law.

    Parameters
    ----------
    model
        With a motor ``replay_NAME`` for each joint, and the parts that the effects need.
    joints
        In the order of the law and the references.
    parameters
        Of the model: effects that take the place of dry friction ask for it.
    effects
        What the model does not have. Of a changed control law, too.
    longest_step
        s; a shaft may need shorter ones.

    Raises
    ------
    UsageError
        See `Effects`.
    """
    period = law.period or 1.0 / references.rate
    delayed = [*effects]
    if law.delay > 0.0:
        delayed.append(SimulatedEffect(name_of("delay"), None, {"delay": law.delay}))
    active, steps = _effects(model, delayed, period, references.start_time, longest_step)
    added = contributions_of(joint_effects(effects, joints), parameters.coulomb)
    loop = _SampledLaw(joints, law, references, added, period)
    return _run(mujoco, model, joints, loop, active, steps)


def _effects(
    model: Any, effects: Sequence[SimulatedEffect], period: float, start_time: float, longest: float
) -> tuple[Effects | None, int]:
    """Effects, and steps in a control period; the model's time step is set."""
    steps = math.ceil(period / longest - 1e-6)
    for halving in range(_HALVINGS + 1):
        model.opt.timestep = period / steps
        if not effects:
            return None, steps
        try:
            return Effects(model, effects, start_time=start_time), steps
        except StepTooLongError:
            if halving == _HALVINGS:
                raise
            steps *= 2
    raise AssertionError("the last halving returns or raises")


class _SampledLaw:
    """The law at its instants, with what it remembers from one to the next."""

    def __init__(
        self,
        joints: Sequence[str],
        law: ControlLaw,
        references: References,
        added: JointContributions,
        period: float,
    ) -> None:
        feedforward, still = law.feedforward, np.zeros(len(joints))
        if feedforward is None:
            feedforward = np.zeros_like(references.position)
        parts = LawParts(*law.torque_gains, feedforward, still, still)
        self._law = changed_law(parts, added, references.velocity, references.rate)
        self._limit, self._speed_factor, self.period = law.torque_limit, law.speed_factor, period
        self.references = references
        count = math.floor((len(references.position) - 1) / references.rate / period + 1e-6) + 1
        self.time = np.arange(count) * period
        uses = 1.0 if law.uses_velocity_reference else 0.0
        self.wanted = self._at(references.position)
        self._speed = uses * self._at(references.velocity)
        self._feedforward = self._at(self._law.feedforward)
        lag = self._law.lag
        self._share = np.where(lag > 0.0, -np.expm1(-period / np.maximum(lag, 1e-12)), 1.0)
        self._integral, self._late = still.copy(), still.copy()
        self._sent: FloatArray | None = None
        self._seen: FloatArray | None = None

    def _at(self, values: FloatArray) -> FloatArray:
        """Values of the samples at the control instants, linear between them."""
        samples = np.arange(len(values)) / self.references.rate
        return np.column_stack([np.interp(self.time, samples, column) for column in values.T])

    def command(self, instant: int, q: FloatArray, dq: FloatArray) -> FloatArray:
        """Torque (n_joints,) that is sent at a control instant, of what the encoders show."""
        law = self._law
        if self._speed_factor is not None:
            if self._seen is None:
                self._late = dq
            else:
                difference = (q - self._seen) / self.period
                self._late = self._late + self._speed_factor * (difference - self._late)
            self._seen, dq = q, self._late
        error = self.wanted[instant] - q
        torque = law.kp * error + law.kd * (self._speed[instant] - dq) + self._feedforward[instant]
        moved = self.period * error
        torque += law.ki * (self._integral + moved)
        free = (np.abs(torque) <= self._limit) | (torque * error < 0.0)
        self._integral[free] += moved[free]
        torque = np.clip(torque, -self._limit, self._limit)
        sent = torque if self._sent is None else self._sent
        self._sent = sent + self._share * (torque - sent)
        return self._sent


def _run(
    mujoco: Any,
    model: Any,
    joints: Sequence[str],
    law: _SampledLaw,
    effects: Effects | None,
    steps: int,
) -> MujocoMotion:
    qpos, dof = (
        np.array([int(getattr(model.joint(name), address)[0]) for name in joints])
        for address in ("qposadr", "dofadr")
    )
    motor = np.array([int(model.actuator(REPLAY + name).id) for name in joints])
    names = () if effects is None else effects.joints
    affected = np.array([joints.index(name) for name in names], dtype=np.int64)
    data, references = mujoco.MjData(model), law.references
    data.qpos[qpos], data.qvel[dof] = references.start, references.speed
    if effects is not None:
        for _ in range(20):  # the slope of an encoder's error is far below one
            data.qpos[qpos[affected]] += references.start[affected] - effects.position(data)
        effects.place_links(model, data)
    mujoco.mj_forward(model, data)
    position, torque = np.zeros((2, *law.wanted.shape))
    before = data.qvel[dof] - model.opt.timestep * data.qacc[dof]
    for k, time in enumerate(law.time):
        q, speed = data.qpos[qpos], data.qvel[dof]
        # MuJoCo's positions move by the velocity of a step's end: it is that of half a step ago.
        # Its accelerations are those before implicit damping.
        dq = speed + 0.5 * (speed - before)
        fast = ~(np.abs(dq) < _FASTEST)
        if np.any(fast):
            joint = joints[int(np.argmax(fast))]
            diverged = f"joint {joint} passed {_FASTEST:g} rad/s (m/s) at {time:.3f} s"
            return MujocoMotion(position[:k], torque[:k], diverged)
        if effects is not None and len(affected):
            q[affected], shown = effects.measured(data)
            dq[affected] += shown - speed[affected]
        position[k], torque[k] = q, law.command(k, q, dq)
        data.ctrl[motor] = torque[k]
        for _ in range(steps):
            before = data.qvel[dof]
            if effects is not None:
                effects.apply(model, data)
            mujoco.mj_step(model, data)
    # At the samples of the references; the torque as it was held.
    samples = np.arange(len(references.position)) / references.rate
    place = np.minimum((samples / law.period + 1e-6).astype(int), len(torque) - 1)
    shown = np.column_stack([np.interp(samples, law.time, column) for column in position.T])
    return MujocoMotion(shown, torque[place])
