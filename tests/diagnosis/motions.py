"""A smooth motion of the two-joint arm that is a sum of sines: every derivative is known."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from bags.simulated_arms import SimulatedArm, arm2
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.refit.command_rows import LawCommands
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.model import DynamicParameters
from idim_iv_ros.signals.decimation import ParallelDecimation
from idim_iv_ros.simulation import inverse_dynamics
from tests.estimation.test_simulated_arms import recorded

RATE = 500.0


@cache
def arm() -> SimulatedArm:
    return arm2(seconds=3.0)


def synthetic(seconds: float = 6.0, rate: float = RATE, still: int | None = None) -> SmoothMotion:
    """Each joint on two sines; joint `still` stands."""
    time = np.arange(round(seconds * rate)) / rate
    pulsation = np.array([[1.7, 2.9], [2.3, 3.7]])
    size = np.array([[0.5, 0.2], [0.4, 0.25]])
    phase = np.array([[0.3, 1.1], [2.0, 0.4]])
    angle = pulsation * time[:, None, None] + phase
    position = 0.3 + np.sum(size * np.sin(angle), axis=2)
    velocity = np.sum(size * pulsation * np.cos(angle), axis=2)
    acceleration = -np.sum(size * pulsation**2 * np.sin(angle), axis=2)
    if still is not None:
        position[:, still] = 0.3
        velocity[:, still] = acceleration[:, still] = 0.0
    return smooth_motion(arm(), position, velocity, acceleration, rate)


def smooth_motion(
    arm: SimulatedArm,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
    rate: float,
    *,
    factor: int = 5,
) -> SmoothMotion:
    """A motion (s, n_joints) of what an arm really is; every row counts."""
    nothing = np.zeros(position.shape[1])
    truth, samples = arm.truth, len(position)
    links = replace(truth, drive_inertia=nothing, viscous=nothing, coulomb=nothing, offset=nothing)
    return SmoothMotion(
        robot=arm.robot,
        links=links,
        whole=truth,
        rate=rate,
        start=0.0,
        time=np.arange(samples) / rate,
        position=position,
        velocity=velocity,
        acceleration=acceleration,
        slip=np.sign(velocity),
        decimation=ParallelDecimation(factor, samples, 0.95),
        kept=np.ones((samples // factor, position.shape[1]), bool),
    )


def gravity_and_coriolis(motion: SmoothMotion, joint: int) -> np.ndarray:
    """Torque (s,) of the links without mass matrix times accelerations, N m."""
    inertial = np.einsum("sj,sj->s", motion.inertia[:, joint], motion.acceleration)
    return np.asarray(motion.load[:, joint] - inertial)


def without_jumps(motion: SmoothMotion) -> SmoothMotion:
    """The same without dry friction."""
    return replace(motion, whole=replace(motion.whole, coulomb=np.zeros(2)))


def added_by(motion: SmoothMotion, parameters: DynamicParameters, *moved: Any) -> np.ndarray:
    """Torque (s, n_joints) that joint 2 adds if its position, speed and acceleration differ."""
    states = [motion.position, motion.velocity, motion.acceleration]
    others = [
        values + np.outer(change, [0.0, 1.0]) for values, change in zip(states, moved, strict=True)
    ]
    before, after = (inverse_dynamics(motion.robot, parameters, *x) for x in (states, others))
    return np.asarray(after - before)


@cache
def arm2_session(seconds: float, rate: float = RATE) -> Baseline:
    """One recording, refitted; what the arm really is differs from its configuration."""
    arm = arm2(seconds=seconds, rate=rate)
    return baseline([recorded(arm, 1)], arm.configuration)


def with_signals(data: Baseline, **changes: Any) -> Baseline:
    """The same session of one recording with other signals."""
    (motion,) = data.prepared.motions
    changed = replace(motion, signals=replace(motion.signals, **changes))
    commands = data.commands and LawCommands((changed,), data.commands.law)
    prepared = replace(data.prepared, motions=(changed,))
    return replace(data, prepared=prepared, commands=commands)
