"""What the diagnosis says of a six-joint arm in MuJoCo, which shares no code with the project.

The plant runs at 16 kHz with dry friction of its own; the law runs at 1 kHz on noisy encoders, its
speed is a filtered difference, and its command is held for the period and logged at its start. The
nominal model is off by ten percent in masses, inertias, drives and friction, and by 10 mm in the
centres of mass. None of this is an effect.

    python -m benchmarks.second_plant --out DIR

writes two bags for each case into DIR, diagnoses them and prints what was said.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from idim_iv_ros import diagnose, load_configuration
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.excitation import Trajectory, random_motion
from idim_iv_ros.recording import JointTopic, write_bag

FloatArray = NDArray[np.float64]

CONFIG = Path(__file__).parent.parent / "config" / "arm6.yaml"
STEPS = 16  # of the plant in one period of the law
SMOOTH = 0.001  # rad/s, below which dry friction falls to zero
ERROR, CENTRE = 0.1, 0.01  # relative errors of the nominal model, and m
ENCODER = 5e-6  # rad
FILTER = 0.5  # of the law's speed
TRUTH = 77  # seed of the robot that is simulated

Friction = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class Case:
    """One difference between the nominal model and the robot.

    `payload` in kg at the flange; `friction`: from speeds and loads of the joints (n,) to torques
    beyond Coulomb and viscous friction (n,).
    """

    name: str
    payload: float = 0.0
    friction: Friction | None = None


def stribeck(speed: FloatArray, load: FloatArray) -> FloatArray:
    """3 N m more at joint 2 below 0.05 rad/s."""
    torque = np.zeros_like(speed)
    torque[1] = 3.0 * np.exp(-((speed[1] / 0.05) ** 2)) * np.tanh(speed[1] / SMOOTH)
    return torque


def load_dependent(speed: FloatArray, load: FloatArray) -> FloatArray:
    """A tenth of the load at joints 2 and 3."""
    share = np.array([0.0, 0.1, 0.1, 0.0, 0.0, 0.0])
    return share * np.abs(load) * np.tanh(speed / SMOOTH)


CASES = (
    Case("none"),
    Case("payload", payload=1.5),
    Case("stribeck", friction=stribeck),
    Case("payload and load-dependent friction", payload=1.5, friction=load_dependent),
)


def robot(configuration: Configuration, payload: float) -> tuple[mujoco.MjModel, FloatArray]:
    """Return the plant, and its Coulomb friction (n,) N m."""
    truth = np.random.default_rng(TRUTH)
    joints = len(configuration.robot.joints)
    model = mujoco.MjSpec.from_file(str(configuration.robot.urdf)).compile()
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.timestep = 0.001 / STEPS
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.jnt_limited[:] = 0
    armature = np.array(configuration.simulator.armature)
    model.dof_armature[:] = armature * (1.0 + ERROR * truth.uniform(-1.0, 1.0, joints))
    for body in range(1, model.nbody):
        factor = 1.0 + ERROR * truth.uniform(-1.0, 1.0)
        model.body_mass[body] *= factor
        model.body_inertia[body] *= factor
        model.body_ipos[body] += CENTRE * truth.uniform(-1.0, 1.0, 3)
    if payload > 0.0:
        last, place = model.nbody - 1, np.array([0.02, 0.0, 0.09])
        mass, centre = float(model.body_mass[last]), model.body_ipos[last].copy()
        model.body_mass[last] = mass + payload
        model.body_ipos[last] = (mass * centre + payload * place) / (mass + payload)
        reduced = mass * payload / (mass + payload)
        model.body_inertia[last] += reduced * float(np.sum((place - centre) ** 2))
    coulomb = model.dof_frictionloss * (1.0 + ERROR * truth.uniform(-1.0, 1.0, joints))
    model.dof_damping[:] *= 1.0 + ERROR * truth.uniform(-1.0, 1.0, joints)
    model.dof_frictionloss[:] = 0.0
    return model, coulomb


def follow(
    configuration: Configuration,
    model: mujoco.MjModel,
    friction: Friction,
    motion: Trajectory,
    seed: int,
    steps: int,
) -> JointTopic:
    """States from the law of `configuration` at work; `steps` of the plant in one of its periods.

    The law runs on noisy encoders with a filtered difference for speed; its command is held.
    """
    noise = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    law = configuration.controller
    kp, kd, limit = (np.array(each) for each in (law.kp, law.kd, law.torque_limit))
    data.qpos[:] = before = motion.position[0]
    speed = motion.velocity[0].copy()
    positions, commands = [], []
    for wanted, wanted_speed in zip(motion.position, motion.velocity, strict=True):
        position = data.qpos + ENCODER * noise.standard_normal(len(kp))
        speed += FILTER * ((position - before) * motion.rate - speed)
        before = position
        command = np.clip(kp * (wanted - position) + kd * (wanted_speed - speed), -limit, limit)
        for _ in range(steps):
            data.qfrc_applied[:] = command - friction(data.qvel, data.qfrc_bias)
            mujoco.mj_step(model, data)
        positions.append(position)
        commands.append(command)
    time = 100.0 * seed + np.arange(len(positions)) / motion.rate
    names = configuration.robot.joints
    return JointTopic("/joint_states", names, time, np.array(positions), None, np.array(commands))


def record(configuration: Configuration, case: Case, motion: Trajectory, seed: int) -> JointTopic:
    """Run one motion; what a driver would publish of it."""
    model, coulomb = robot(configuration, case.payload)

    def friction(speed: FloatArray, load: FloatArray) -> FloatArray:
        torque: FloatArray = coulomb * np.tanh(speed / SMOOTH)
        return torque if case.friction is None else torque + case.friction(speed, load)

    return follow(configuration, model, friction, motion, seed, STEPS)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=40.0)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    configuration = load_configuration(CONFIG)
    for case in CASES:
        bags = []
        for seed in (1, 2):
            motion = random_motion(
                configuration, duration=arguments.seconds, rate=1000.0, seed=seed
            )
            states = record(configuration, case, motion, seed)
            reference = JointTopic(
                "/joint_reference", states.joints, states.time, motion.position, motion.velocity
            )
            bags.append(arguments.out / f"{case.name.replace(' ', '_')}-{seed}.mcap")
            write_bag(bags[-1], [states, reference])
        result = diagnose(bags, configuration)
        print(f"== {case.name}: {result.verdict}")
        print(result.summary, "\n")


if __name__ == "__main__":
    main()
