"""Simulation of the closed loop: the source of the instruments and of simulated robots."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.effects.contribution import (
    CommandDelay,
    LawChange,
    ShaftPart,
    reference_direction,
)
from idim_iv_ros.effects.control_law import ControlLaw
from idim_iv_ros.model import DynamicParameters, RobotModel
from idim_iv_ros.signals.filters import central_differences
from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.simulation import closed_loop_kernel
from idim_iv_ros.simulation.affected_robot import (
    affected_robot,
    encoder_error,
    link_positions,
    true_state,
)
from idim_iv_ros.simulation.closed_loop_kernel import SPEED_LIMIT, Loop, Trace
from idim_iv_ros.simulation.effect_kernel import Effects
from idim_iv_ros.simulation.effects import JointContributions, SimulatedEffect, contributions_of
from idim_iv_ros.simulation.plant import initial_state, plant, workspace
from idim_iv_ros.types import FloatArray

PLANT_STEP = 0.5e-3  # Longest plant step when the caller gives none, s


@dataclass(frozen=True)
class ClosedLoopResult:
    """Motion and torques of a simulated closed loop at the samples of its references."""

    rate: float  # Hz
    # position, velocity: (n_samples, n_joints) rad, rad/s (m, m/s). Fewer samples than the
    # references have if it diverged. Of the motor, where motor and link are two masses.
    position: FloatArray
    velocity: FloatArray
    # (n_samples, n_joints) rad/s² (m/s²). The held torque steps at control instants, and the
    # acceleration with it; where a sample falls on a step this is the mean of both sides, which
    # central differences of the position approach too. (0, n_joints) where it was not asked for.
    acceleration: FloatArray
    # (n_samples, n_joints): last torque command, N m (N); without delay it acts from the sample's
    # instant on
    torque: FloatArray
    # (n_samples, n_joints): the torque that `acceleration` belongs to: that on the joints, the
    # disturbance included, mean of both sides
    applied_torque: FloatArray
    diverged: str | None  # Why the simulation ended early, in words; None if it did not
    # measured_position, measured_velocity: (n_samples, n_joints): what the encoders show and the
    # control sees: `position`, `velocity` but for the effect `encoder_eccentricity`
    measured_position: FloatArray
    measured_velocity: FloatArray
    # link_position, link_velocity: (n_samples, n_joints): `position`, `velocity` but for the
    # effects `elasticity` and `backlash`
    link_position: FloatArray
    link_velocity: FloatArray


def simulate_closed_loop(
    robot: RobotModel,
    parameters: DynamicParameters,
    law: ControlLaw,
    *,
    rate: float,
    position_reference: FloatArray,
    velocity_reference: FloatArray | None = None,
    initial_position: FloatArray,
    initial_velocity: FloatArray,
    disturbance: FloatArray | None = None,
    plant_step: float | None = None,
    effects: Sequence[SimulatedEffect] | None = None,
    start_time: float = 0.0,
    accelerations: bool = True,
) -> ClosedLoopResult:
    """Simulate a robot under its control law, from the first to the last reference sample.

    The law sees the true position and velocity, or differences of the position through a filter
    (`ControlLaw.speed_factor`). Negative friction is simulated as none: Fv, Fc
    and Fcm below zero count as zero, Fvm is kept within what dissipates. Before the first command
    arrives through a transport delay, the first command is taken to have been held.

    - `robot`, `parameters`: kinematics, and dynamic parameters that need not be physical
    - `law`: its period may differ from that of the references, which are interpolated linearly
    - `rate`: of the references and of the result, Hz
    - `position_reference`, `velocity_reference`: (n_samples, n_joints) rad, rad/s. A law that uses
      a velocity reference which is not given gets central differences of the position reference.
    - `initial_position`, `initial_velocity`: (n_joints,) rad, rad/s, as the encoders show them.
      Links behind a shaft start where gravity holds them.
    - `disturbance`: (n_samples, n_joints) N m (N): torque on the joints that no model explains and
      no command holds, each value from its sample to the next
    - `plant_step`: longest time step of the plant, s; default: the control period divided into
      equal steps of at most 0.5 ms. An elastic shaft may need shorter ones.
    - `effects`: what the robot has beyond `parameters` (docs/simulation.md)
    - `start_time`: s since the start of the session, for friction that drifts
    - `accelerations`: whether the result holds them: each costs as much as a time step

    Raises UsageError: an effect that is not known, or whose parameters cannot be (see `effects`,
    `affected_robot`).
    """
    position_reference = np.asarray(position_reference, dtype=float)
    joints = position_reference.shape[1]
    period = 1.0 / rate if law.period is None else law.period
    step = period / math.ceil(period / PLANT_STEP - 1e-6) if plant_step is None else plant_step
    present = contributions_of(effects or (), robot.joints, parameters.coulomb)
    q, dq = np.array(initial_position, dtype=float), np.array(initial_velocity, dtype=float)
    arrays: Effects | None = None
    shafts: dict[int, ShaftPart] = {}
    if present.items:
        q, dq = true_state(present, q, dq)
        dynamics, arrays, shafts, longest = affected_robot(
            robot, parameters, present, start_time=start_time, position=q
        )
        step = min(step, longest)
    else:
        dynamics = plant(robot, parameters)
    behind = list(shafts)
    loop = sampled_loop(
        robot, law, present, position_reference, velocity_reference, disturbance, rate, step
    )
    links = link_positions(robot, parameters, shafts, q) if shafts else q
    start = np.concatenate([q[robot.order], links[behind]])
    start_speed = np.concatenate([dq[robot.order], dq[behind]])
    state = initial_state(dynamics, start, start_speed, loop.delay, loop.period)
    samples, coordinates = len(position_reference), joints + len(shafts)
    accelerated = np.zeros((samples if accelerations else 0, coordinates))
    motion, torques = np.zeros((2, samples, coordinates)), np.zeros((2, samples, joints))
    trace = Trace._make([*motion, accelerated, *torques])
    outcome, coordinate, recorded, time = closed_loop_kernel.run_closed_loop(
        dynamics, arrays, loop, state, trace, workspace(dynamics)
    )
    diverged = None
    if outcome == closed_loop_kernel.TOO_FAST:
        joint = robot.order[coordinate] if coordinate < joints else behind[coordinate - joints]
        unit = "rad/s" if robot.joint_types[joint] == "revolute" else "m/s"
        diverged = f"joint {robot.joints[joint]} passed {SPEED_LIMIT:g} {unit} at {time:.3f} s"
    elif outcome != closed_loop_kernel.COMPLETED:
        diverged = f"the mass matrix is not positive definite at {time:.3f} s"
    place = np.argsort(robot.order)
    position, speed, acceleration, torque, applied = (
        np.ascontiguousarray(values[:recorded, place]) for values in trace
    )
    measured, measured_speed, link, link_speed = position, speed, position, speed
    if present.items:
        error, slope = encoder_error(present, position)
        measured, measured_speed = position + error, speed * (1.0 + slope)
    if behind:
        link, link_speed = position.copy(), speed.copy()
        link[:, behind] = trace.position[:recorded, joints:]
        link_speed[:, behind] = trace.velocity[:recorded, joints:]
    return ClosedLoopResult(
        rate=rate,
        position=position,
        velocity=speed,
        acceleration=acceleration,
        torque=torque,
        applied_torque=applied,
        diverged=diverged,
        measured_position=measured,
        measured_velocity=measured_speed,
        link_position=link,
        link_velocity=link_speed,
    )


def sampled_loop(
    robot: RobotModel,
    law: ControlLaw,
    added: JointContributions,
    position_reference: FloatArray,
    velocity_reference: FloatArray | None,
    disturbance: FloatArray | None,
    rate: float,
    plant_step: float,
) -> Loop:
    """Return the law with what effects change of it, references and instants, in tree order."""
    speed: FloatArray = np.zeros_like(position_reference)
    if law.velocity_reference or added.items:
        if velocity_reference is not None:
            speed = np.asarray(velocity_reference, dtype=float)
        elif len(speed) > 1:
            speed = np.gradient(position_reference, 1.0 / rate, axis=0)
    none, undelayed = np.zeros_like(speed), np.zeros(len(robot.joints))
    loop = Loop(
        kp=law.kp.copy(),
        kd=law.kd.copy(),
        ki=law.ki.copy(),
        limit=law.torque_limit,
        position=position_reference,
        velocity=speed if law.velocity_reference else none,
        feedforward=none.copy() if law.feedforward is None else law.feedforward.copy(),
        disturbance=none if disturbance is None else disturbance,
        rate=float(rate),
        period=float(1.0 / rate if law.period is None else law.period),
        delay=law.delay + undelayed,
        lag=undelayed,
        plant_step=float(plant_step),
        speed_factor=0.0 if law.speed_factor is None else float(law.speed_factor),
    )
    for j, delay in added.of(CommandDelay):
        loop.delay[j] += delay.seconds
    for j, change in added.of(LawChange):
        for name in ("kp", "kd", "ki"):
            gain = getattr(change, name)
            if not np.isnan(gain):
                getattr(loop, name)[j] = gain
        of_joint = speed[:, j]
        loop.feedforward[:, j] += change.feedforward_velocity * of_joint
        loop.feedforward[:, j] += change.feedforward_friction * reference_direction(of_joint)
        if len(speed) > 1:
            acceleration = np.gradient(of_joint, 1.0 / loop.rate)
            loop.feedforward[:, j] += change.feedforward_acceleration * acceleration
        loop.lag[j] = change.lag
    return Loop._make(
        np.ascontiguousarray(part[..., robot.order], dtype=float)
        if isinstance(part, np.ndarray)
        else part
        for part in loop
    )


def replay(
    robot: RobotModel,
    parameters: DynamicParameters,
    law: ControlLaw,
    motion: Motion,
    *,
    effects: Sequence[SimulatedEffect] | None = None,
    start_time: float = 0.0,
    accelerations: bool = True,
) -> ClosedLoopResult:
    """Simulate a recording's whole reference from the state in which the recording began.

    - `motion`: with a reference; the start is its filtered position and speed
    - `effects`, `start_time`, `accelerations`: see `simulate_closed_loop`

    Raises ValueError: the recording has no reference; UsageError: see `simulate_closed_loop`.
    """
    signals = motion.signals
    if signals.position_reference is None:
        raise ValueError(f"{signals.name} has no reference")
    velocity, _ = central_differences(motion.position, rate=signals.rate, start=0, stop=1)
    return simulate_closed_loop(
        robot,
        parameters,
        law,
        rate=signals.rate,
        position_reference=signals.position_reference,
        velocity_reference=signals.velocity_reference,
        initial_position=motion.position[0],
        initial_velocity=velocity[0],
        effects=effects,
        start_time=start_time,
        accelerations=accelerations,
    )
