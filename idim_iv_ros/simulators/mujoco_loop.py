"""Closed loop of a control law and references with a MuJoCo model."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from idim_iv_ros.effects.registry import name_of
from idim_iv_ros.model import DynamicParameters, RobotModel
from idim_iv_ros.simulation import ControlLaw, SimulatedEffect
from idim_iv_ros.simulation.closed_loop import sampled_loop
from idim_iv_ros.simulation.closed_loop_kernel import SPEED_LIMIT, send_command
from idim_iv_ros.simulation.effects import contributions_of
from idim_iv_ros.simulation.plant import initial_state, plant
from idim_iv_ros.simulators.mujoco import REPLAY, Effects, StepTooLongError
from idim_iv_ros.types import FloatArray

# Longest step when nothing asks for a shorter one, s, and how often it is halved for a shaft.
LONGEST_STEP = 0.5e-3
_HALVINGS = 6


@dataclass(frozen=True)
class References:
    """References of one recording, and the initial state of its robot."""

    rate: float  # Hz
    position: FloatArray  # (n_samples, n_joints) rad (m)
    # (n_samples, n_joints): central differences of the positions where none was recorded
    velocity: FloatArray
    start: FloatArray  # (n_joints,): position at the first sample, as the encoders show it
    speed: FloatArray  # (n_joints,): velocity there
    start_time: float  # s since the start of the session


@dataclass(frozen=True)
class MujocoMotion:
    """Simulated measurements, (n_samples, n_joints) each."""

    position: FloatArray  # rad (m): of the encoders
    torque: FloatArray  # N m (N): command of the law
    diverged: str = ""  # why the simulation ended early; empty if it did not


def run_in_mujoco(
    mujoco: Any,
    model: Any,
    robot: RobotModel,
    law: ControlLaw,
    references: References,
    parameters: DynamicParameters,
    effects: Sequence[SimulatedEffect] = (),
    *,
    longest_step: float = LONGEST_STEP,
) -> MujocoMotion:
    """Simulate references and a control law in closed loop; return position and torque.

    - `model`: with motors ``replay_NAME`` of the joints, and the parts that `effects` need
    - `robot`: its joints have the order of the law and the references
    - `parameters`: those of the model; effects that replace dry friction need them
    - `effects`: effects that are not in the model already, and changes of the control law
    - `longest_step`: largest time step, s; a shaft may need shorter ones

    Raises UsageError: see `Effects`.
    """
    period = law.period or 1.0 / references.rate
    acting = [*effects]
    if law.delay > 0.0:
        acting.append(SimulatedEffect(name_of("delay"), None, {"delay": law.delay}))
    steps = math.ceil(period / longest_step - 1e-6)  # in a control period
    most = steps << _HALVINGS
    active: Effects | None = None
    while acting and active is None:
        model.opt.timestep = period / steps
        try:
            active = Effects(model, acting, start_time=references.start_time)
        except StepTooLongError:
            if steps >= most:
                raise
            steps *= 2
    model.opt.timestep = period / steps
    added = contributions_of(effects, robot.joints, parameters.coulomb)
    loop = sampled_loop(
        robot, law, added, references.position, references.velocity, None, references.rate, period
    )
    # All that follows is in the order of the tree, as the loop.
    joints = [robot.joints[joint] for joint in robot.order]
    start, speed = references.start[robot.order], references.speed[robot.order]
    # The motors of the model hold the command back, not the law.
    state = initial_state(plant(robot, parameters), start, speed, 0.0 * start, period)
    qpos, dof = (
        np.array([int(getattr(model.joint(name), address)[0]) for name in joints])
        for address in ("qposadr", "dofadr")
    )
    motor = np.array([int(model.actuator(REPLAY + name).id) for name in joints])
    names = () if active is None else active.joints
    affected = np.array([joints.index(name) for name in names], dtype=np.int64)
    data = mujoco.MjData(model)
    data.qpos[qpos], data.qvel[dof] = start, speed
    if active is not None:
        for _ in range(20):  # the slope of an encoder's error is far below one
            data.qpos[qpos[affected]] += start[affected] - active.position(data)
        active.place_links(model, data)
    mujoco.mj_forward(model, data)
    samples = np.arange(len(loop.position)) / loop.rate
    instants = np.arange(math.floor(samples[-1] / period + 1e-6) + 1) * period
    position, torque = np.zeros((2, len(instants), len(joints)))
    before, place = data.qvel[dof] - model.opt.timestep * data.qacc[dof], np.argsort(robot.order)
    for k, time in enumerate(instants):
        q, now = data.qpos[qpos], data.qvel[dof]
        # MuJoCo's positions move by the velocity of a step's end: it is that of half a step ago.
        # Its accelerations are those before implicit damping.
        dq = now + 0.5 * (now - before)
        fast = ~(np.abs(dq) < SPEED_LIMIT)
        if np.any(fast):
            joint = joints[int(np.argmax(fast))]
            diverged = f"joint {joint} passed {SPEED_LIMIT:g} rad/s (m/s) at {time:.3f} s"
            return MujocoMotion(position[:k, place], torque[:k, place], diverged)
        if active is not None and len(affected):
            q[affected], shown = active.measured(data)
            dq[affected] += shown - now[affected]
        position[k] = q
        send_command(loop, state, k, q, dq, torque[k])
        data.ctrl[motor] = torque[k]
        for _ in range(steps):
            before = data.qvel[dof]
            if active is not None:
                active.apply(model, data)
            mujoco.mj_step(model, data)
    # At the samples of the references; the torque as it was held.
    sampled = np.column_stack([np.interp(samples, instants, column) for column in position.T])
    last = np.minimum((samples / period + 1e-6).astype(int), len(torque) - 1)
    return MujocoMotion(sampled[:, place], torque[last][:, place])
