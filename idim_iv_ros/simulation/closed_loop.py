"""Simulation of the closed loop: the source of the instruments and of simulated robots."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.model.parameters import DynamicParameters
from idim_iv_ros.model.robot import RobotModel
from idim_iv_ros.simulation.closed_loop_kernel import (
    COMPLETED,
    SPEED_LIMIT,
    TOO_FAST,
    Loop,
    Trace,
    run_closed_loop,
)
from idim_iv_ros.simulation.controller import ControlLaw
from idim_iv_ros.simulation.plant import plant, workspace

FloatArray = NDArray[np.float64]

# Longest plant step when the caller gives none, s.
PLANT_STEP = 0.5e-3


@dataclass(frozen=True)
class ClosedLoopResult:
    """Motion and torques of a simulated closed loop at the samples of its references.

    Attributes
    ----------
    rate : float
        Hz.
    position, velocity : (n_samples, n_joints)
        rad, rad/s (m, m/s). Fewer samples than the references have if it diverged.
    acceleration : (n_samples, n_joints)
        rad/s² (m/s²). The held torque steps at control instants, and the acceleration with it;
        where a sample falls on a step this is the mean of both sides, which central differences
        of the position approach too.
    torque : (n_samples, n_joints)
        Last torque command, N m (N); without delay it acts from the sample's instant on.
    applied_torque : (n_samples, n_joints)
        The torque that `acceleration` belongs to: that on the joints, the disturbance included,
        mean of both sides.
    diverged : str or None
        Why the simulation ended early, in words; None if it did not.
    """

    rate: float
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    torque: FloatArray
    applied_torque: FloatArray
    diverged: str | None


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
) -> ClosedLoopResult:
    """Simulate a robot under its control law, from the first to the last reference sample.

    The law sees the true position and velocity. Negative friction is simulated as none: Fv, Fc
    and Fcm below zero count as zero, Fvm is kept within what dissipates. Before the first command
    arrives through a transport delay, the first command is taken to have been held.

    Parameters
    ----------
    robot, parameters
        Kinematics, and dynamic parameters that need not be physical.
    law
        Its period may differ from that of the references, which are interpolated linearly.
    rate
        Of the references and of the result, Hz.
    position_reference, velocity_reference
        (n_samples, n_joints) rad, rad/s. A law that uses a velocity reference which is not
        given gets central differences of the position reference.
    initial_position, initial_velocity
        (n_joints,) rad, rad/s.
    disturbance
        (n_samples, n_joints) N m (N): torque on the joints that no model explains and no command
        holds, each value from its sample to the next.
    plant_step
        Longest time step of the plant, s; default: the control period divided into equal steps
        of at most 0.5 ms.
    """
    position_reference = np.asarray(position_reference, dtype=float)
    samples, joints = position_reference.shape
    order = robot.order
    place = np.argsort(order)
    period = 1.0 / rate if law.period is None else law.period
    step = period / math.ceil(period / PLANT_STEP - 1e-6) if plant_step is None else plant_step

    def tree(values: FloatArray) -> FloatArray:
        return np.ascontiguousarray(np.asarray(values, dtype=float)[..., order])

    velocity = np.zeros_like(position_reference)
    if law.uses_velocity_reference and velocity_reference is not None:
        velocity = np.asarray(velocity_reference, dtype=float)
    elif law.uses_velocity_reference and samples > 1:
        velocity = np.gradient(position_reference, 1.0 / rate, axis=0)
    feedforward = np.zeros_like(velocity) if law.feedforward is None else law.feedforward
    kp, kd, ki = law.torque_gains
    loop = Loop(
        kp=tree(kp),
        kd=tree(kd),
        ki=tree(ki),
        limit=tree(law.torque_limit),
        position=tree(position_reference),
        velocity=tree(velocity),
        feedforward=tree(feedforward),
        disturbance=tree(np.zeros_like(velocity) if disturbance is None else disturbance),
        rate=float(rate),
        period=float(period),
        delay=float(law.delay),
        plant_step=float(step),
    )
    dynamics = plant(robot, parameters)
    trace = Trace(*(np.zeros((samples, joints)) for _ in range(5)))
    outcome, joint, recorded, time = run_closed_loop(
        dynamics,
        loop,
        tree(initial_position).copy(),
        tree(initial_velocity).copy(),
        trace,
        workspace(dynamics),
    )
    diverged = None
    if outcome == TOO_FAST:
        unit = "rad/s" if robot.joint_types[order[joint]] == "revolute" else "m/s"
        name = robot.joints[order[joint]]
        diverged = f"joint {name} passed {SPEED_LIMIT:g} {unit} at {time:.3f} s"
    elif outcome != COMPLETED:
        diverged = f"the mass matrix is not positive definite at {time:.3f} s"
    position, speed, acceleration, torque, applied = (
        np.ascontiguousarray(values[:recorded, place]) for values in trace
    )
    return ClosedLoopResult(rate, position, speed, acceleration, torque, applied, diverged)
