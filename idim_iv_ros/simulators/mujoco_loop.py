"""A control law and its references in the closed loop with a MuJoCo model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from idim_iv_ros.effects.registry import name_of
from idim_iv_ros.model import DynamicParameters
from idim_iv_ros.simulation import ControlLaw, SimulatedEffect
from idim_iv_ros.simulation.affected_robot import LawParts, changed_law, contributions_of
from idim_iv_ros.simulation.effects import joint_effects
from idim_iv_ros.simulators.mujoco import Effects
from idim_iv_ros.simulators.mujoco_plant import REPLAY
from idim_iv_ros.simulators.mujoco_shaft import StepTooLongError
from idim_iv_ros.types import FloatArray

# Longest step when nothing asks for a shorter one, s, and how often it is halved for a shaft.
LONGEST_STEP = 0.5e-3
_HALVINGS = 6
_FASTEST = 1e3  # rad/s (m/s): beyond it the simulation has diverged


@dataclass(frozen=True)
class References:
    """What one recording asked for, and where its robot began.

    Attributes
    ----------
    rate : float
        Hz.
    position : (n_samples, n_joints)
        rad (m).
    velocity : (n_samples, n_joints)
        Central differences of the positions where none was recorded.
    start, speed : (n_joints,)
        Position and velocity at the first sample, as the encoders show them.
    start_time : float
        s since the start of the session.
    """

    rate: float
    position: FloatArray
    velocity: FloatArray
    start: FloatArray
    speed: FloatArray
    start_time: float


@dataclass(frozen=True)
class MujocoMotion:
    """What a recorder would have seen, (n_samples, n_joints) each.

    Attributes
    ----------
    position : rad (m)
        Of the encoders.
    torque : N m (N)
        Command of the law.
    diverged : str
        Why it ended early; empty if it did not.
    """

    position: FloatArray
    torque: FloatArray
    diverged: str = ""


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
    loop = _Loop(mujoco, model, joints, law, references, parameters, effects, period)
    return loop.run(active, steps)


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


class _Loop:
    """The law, sampled, and where the joints are in the model."""

    def __init__(
        self,
        mujoco: Any,
        model: Any,
        joints: Sequence[str],
        law: ControlLaw,
        references: References,
        parameters: DynamicParameters,
        effects: Sequence[SimulatedEffect],
        period: float,
    ) -> None:
        self._mujoco, self._model, self._references = mujoco, model, references
        self._joints, self._period = joints, period
        self._qpos = np.array([int(model.joint(name).qposadr[0]) for name in joints])
        self._dof = np.array([int(model.joint(name).dofadr[0]) for name in joints])
        self._motor = np.array([int(model.actuator(REPLAY + name).id) for name in joints])
        n = len(joints)
        added = contributions_of(joint_effects(effects, joints), parameters)
        feedforward = law.feedforward
        if feedforward is None:
            feedforward = np.zeros_like(references.position)
        still = np.zeros(n)
        parts = LawParts(*law.torque_gains, feedforward, still, still)
        self._law = changed_law(parts, added, references.velocity, references.rate)
        self._limit = law.torque_limit
        self._speed_factor = law.speed_factor
        count = math.floor((len(references.position) - 1) / references.rate / period + 1e-6) + 1
        self._time = np.arange(count) * period
        self._wanted = self._at(references.position)
        uses = law.uses_velocity_reference
        self._speed = self._at(references.velocity if uses else np.zeros_like(references.velocity))
        self._feedforward = self._at(self._law.feedforward)

    def _at(self, values: FloatArray) -> FloatArray:
        """Values of the samples at the control instants, linear between them."""
        samples = np.arange(len(values)) / self._references.rate
        columns = [np.interp(self._time, samples, column) for column in values.T]
        return np.column_stack(columns)

    def run(self, effects: Effects | None, steps: int) -> MujocoMotion:
        mujoco, model = self._mujoco, self._model
        data = mujoco.MjData(model)
        self._start(data, effects)
        law, limit = self._law, self._limit
        own = np.zeros(0, dtype=np.int64)
        if effects is not None:
            own = np.array([self._joints.index(name) for name in effects.joints], dtype=np.int64)
        position = np.zeros_like(self._wanted)
        torque = np.zeros_like(self._wanted)
        integral = np.zeros(len(self._joints))
        lag = np.where(law.lag > 0.0, -np.expm1(-self._period / np.maximum(law.lag, 1e-12)), 1.0)
        sent: FloatArray | None = None
        seen: FloatArray | None = None
        late = np.zeros(len(self._joints))
        before = data.qvel[self._dof] - model.opt.timestep * data.qacc[self._dof]
        for k, wanted in enumerate(self._wanted):
            q = data.qpos[self._qpos]
            # MuJoCo's positions move by the velocity of a step's end: it is that of half a step
            # ago. Its accelerations are those before implicit damping.
            speed = data.qvel[self._dof]
            dq = speed + 0.5 * (speed - before)
            if not np.all(np.abs(dq) < _FASTEST):
                return self._recorded(position[:k], torque[:k], self._lost(dq, k))
            if effects is not None and len(own):
                true = data.qvel[self._dof[own]]
                q[own], shown = effects.measured(data)
                dq[own] += shown - true
            if self._speed_factor is not None:
                difference = dq if seen is None else (q - seen) / self._period
                late = dq if seen is None else late + self._speed_factor * (difference - late)
                seen, dq = q, late
            error = wanted - q
            command = law.kp * error + law.kd * (self._speed[k] - dq) + self._feedforward[k]
            moved = self._period * error
            command += law.ki * (integral + moved)
            free = (np.abs(command) <= limit) | (command * error < 0.0)
            integral[free] += moved[free]
            command = np.minimum(np.maximum(command, -limit), limit)
            sent = command if sent is None else sent + lag * (command - sent)
            position[k], torque[k] = q, sent
            data.ctrl[self._motor] = sent
            if effects is None:
                if steps > 1:
                    mujoco.mj_step(model, data, steps - 1)
                before = data.qvel[self._dof]
                mujoco.mj_step(model, data)
            else:
                for _ in range(steps):
                    before = data.qvel[self._dof]
                    effects.apply(model, data)
                    mujoco.mj_step(model, data)
        return self._recorded(position, torque, "")

    def _start(self, data: Any, effects: Effects | None) -> None:
        start = self._references
        data.qpos[self._qpos], data.qvel[self._dof] = start.start, start.speed
        if effects is not None:
            for _ in range(20):  # the slope of an encoder's error is far below one
                shown = effects.position(data)
                own = [self._joints.index(name) for name in effects.joints]
                data.qpos[self._qpos[own]] += start.start[own] - shown
            effects.place_links(self._model, data)
        self._mujoco.mj_forward(self._model, data)

    def _lost(self, dq: FloatArray, instant: int) -> str:
        joint = self._joints[int(np.argmin(np.abs(dq) < _FASTEST))]
        return f"joint {joint} passed {_FASTEST:g} rad/s (m/s) at {self._time[instant]:.3f} s"

    def _recorded(self, position: FloatArray, torque: FloatArray, diverged: str) -> MujocoMotion:
        """At the samples of the references; the torque as it was held."""
        count = len(self._references.position)
        samples = np.arange(count) / self._references.rate
        place = np.minimum((samples / self._period + 1e-6).astype(int), len(torque) - 1)
        if diverged:
            return MujocoMotion(position, torque, diverged)
        time = self._time
        shown = np.column_stack([np.interp(samples, time, column) for column in position.T])
        return MujocoMotion(shown, torque[place])
