"""Recordings of a robot, from the project's own simulation and from MuJoCo."""

from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.payload.robots import Robot
from benchmarks.second_plant import ENCODER, follow
from idim_iv_ros.excitation import Trajectory
from idim_iv_ros.model import load_robot
from idim_iv_ros.recording import JointTopic, write_bag
from idim_iv_ros.simulation import SimulatedEffect, control_law, record_simulated_robot

FloatArray = NDArray[np.float64]

LOADED = {"arm2": (0, 1), "arm6": (1, 2), "arm7": (1, 3)}  # joints that carry gravity
SHARES = (0.1, 0.08)  # of the load, at these joints
EXCESS = 0.8  # of the joint's Coulomb friction, Stribeck's, at the first of them
STRIBECK_SPEED = 0.06  # rad/s
TORQUE_NOISE = 0.002  # of the torque limit
STEPS = 8  # of MuJoCo in one period of the law
SMOOTH = 0.002  # rad/s, below which dry friction falls to zero in MuJoCo


@dataclass(frozen=True)
class Plant:
    """A robot as it really is.

    `factors` (n,): recorded torque over the true one; `tilt`: of gravity about x, rad.
    """

    robot: Robot
    friction: str
    factors: FloatArray
    tilt: float = 0.0

    @property
    def gravity(self) -> list[float]:
        """Acceleration in the base frame, m/s²."""
        return [0.0, 9.81 * float(np.sin(self.tilt)), -9.81 * float(np.cos(self.tilt))]


def record(kind: str, plant: Plant, arm: str, motion: Trajectory, seed: int, path: Path) -> None:
    """Record one motion into a bag."""
    states = (_own if kind == "own" else _mujoco)(plant, arm, motion, seed)
    joints = plant.robot.configuration.robot.joints
    effort = np.asarray(states.effort) * plant.factors
    states = replace(states, effort=effort)
    reference = JointTopic(
        "/joint_reference", joints, states.time[: len(motion.position)],
        motion.position[: len(states.time)], motion.velocity[: len(states.time)],
    )  # fmt: skip
    write_bag(path, [states, reference], force=True)


def effects(plant: Plant, arm: str) -> list[SimulatedEffect]:
    """The friction of a plant as effects of the catalogue."""
    joints = plant.robot.configuration.robot.joints
    if plant.friction == "load":
        return [
            SimulatedEffect(
                "load_dependent_friction", joints[joint], {"driving": share, "driven": share}
            )
            for joint, share in zip(LOADED[arm], SHARES, strict=True)
        ]
    if plant.friction == "stribeck":
        joint = LOADED[arm][0]
        excess = EXCESS * float(plant.robot.parameters.coulomb[joint])
        numbers = {"excess": excess, "speed": STRIBECK_SPEED}
        return [SimulatedEffect("stribeck", joints[joint], numbers)]
    return []


def _own(plant: Plant, arm: str, motion: Trajectory, seed: int) -> JointTopic:
    configuration = plant.robot.configuration
    section = configuration.robot
    assert section.urdf is not None
    robot = load_robot(
        section.urdf.read_text(encoding="utf-8"),
        section.joints,
        gravity=plant.gravity,
        armature=configuration.simulator.armature,
        source=section.urdf.name,
    )
    limits = np.asarray(configuration.controller.torque_limit)
    recorded = record_simulated_robot(
        robot,
        robot.given,
        control_law(configuration.controller, len(section.joints)),
        motion.position,
        motion.velocity,
        rate=motion.rate,
        seed=seed,
        position_noise=ENCODER,
        torque_noise=TORQUE_NOISE * limits,
        effects=effects(plant, arm),
    )
    time = 100.0 * seed + recorded.time
    return JointTopic(
        "/joint_states", section.joints, time, recorded.position, None, recorded.effort
    )


def _mujoco(plant: Plant, arm: str, motion: Trajectory, seed: int) -> JointTopic:
    configuration = plant.robot.configuration
    model = mujoco.MjSpec.from_file(str(configuration.robot.urdf)).compile()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.timestep = 1.0 / motion.rate / STEPS
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.gravity[:] = plant.gravity
    model.jnt_limited[:] = 0
    model.dof_armature[:] = configuration.simulator.armature
    coulomb = model.dof_frictionloss.copy()
    model.dof_frictionloss[:] = 0.0
    shares = np.zeros(model.nv)
    excess = np.zeros(model.nv)
    if plant.friction == "load":
        shares[list(LOADED[arm])] = SHARES
    if plant.friction == "stribeck":
        excess[LOADED[arm][0]] = EXCESS * coulomb[LOADED[arm][0]]

    def friction(speed: FloatArray, load: FloatArray) -> FloatArray:
        level = coulomb + shares * np.abs(load) + excess * np.exp(-((speed / STRIBECK_SPEED) ** 2))
        return np.asarray(level * np.tanh(speed / SMOOTH))

    return follow(configuration, model, friction, motion, seed, STEPS)
