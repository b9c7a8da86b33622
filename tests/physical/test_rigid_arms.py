"""How often a rigid arm with soft dry friction is called impossible: simulated in MuJoCo."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.stats import binom

from idim_iv_ros import identify
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.recording.writing.write import JointTopic, write_bag

ARMS = 200
RATE, SECONDS = 1000, 12


def chain(joints: int, random: np.random.Generator) -> str:
    """A serial arm of rods with motors; axes turn from joint to joint."""
    text = ["<mujoco><compiler angle='radian'/><worldbody>"]
    mass, length = 8.0, 0.4
    for joint in range(joints):
        axis = ("0 0 1", "0 1 0", "1 0 0")[joint % 3 if joint else 0]
        moment = mass * length**2 / 12.0
        if joint == joints - 1:  # a flange: thin, and light beside what it may carry
            mass, moment = 0.5, 2e-4
        thin = 0.1 * moment if joint < joints - 1 else 1e-6
        text.append(
            f"<body name='link_{joint}' pos='0 0 {length:.4g}'>"
            f"<inertial pos='{0.02 * random.normal():.4g} {0.02 * random.normal():.4g} "
            f"{0.5 * length if joint < joints - 1 else 0.02:.4g}' mass='{mass:.4g}' "
            f"diaginertia='{moment:.4g} {moment:.4g} {thin:.4g}'/>"
            f"<joint name='joint_{joint}' axis='{axis}' range='-2 2' "
            f"armature='{0.05 * mass * random.uniform(0.5, 1.5):.4g}' "
            f"damping='{0.1 * mass:.4g}' frictionloss='{0.3 * mass:.4g}'/>"
        )
        mass, length = mass * random.uniform(0.5, 0.8), length * random.uniform(0.7, 0.9)
    return "".join([*text, "</body>" * joints, "</worldbody></mujoco>"])


def robot(text: str, random: np.random.Generator) -> mujoco.MjModel:
    """An arm with other links, drives and friction than the file; half of them with a load."""
    spec = mujoco.MjSpec.from_string(text)
    if random.uniform() < 0.5:
        load = spec.bodies[-1].add_body(pos=[0.0, 0.0, 0.1])
        load.mass, load.inertia = random.uniform(0.3, 2.0), [2e-3, 2e-3, 1e-3]
        load.ipos, load.explicitinertial = 0.05 * random.normal(size=3), True
    model = spec.compile()
    model.opt.timestep, model.opt.integrator = 0.5e-3, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.jnt_limited[:] = 0
    for body in range(1, model.nbody):
        factor = np.exp(0.15 * random.normal())
        model.body_mass[body] *= factor
        model.body_inertia[body] *= factor
        model.body_ipos[body] += 0.01 * random.normal(size=3)
    for values in (model.dof_armature, model.dof_damping[..., None], model.dof_frictionloss):
        values *= np.exp(0.2 * random.normal(size=values.shape))
    return model


def rigid(number: int, folder: Path) -> PhysicalParameters:
    """The physical parameters that an identification of this arm has."""
    random = np.random.default_rng(number)
    joints = 2 + number % 6
    text = chain(joints, random)
    model = robot(text, random)
    time = np.arange(RATE * SECONDS) / RATE
    pulse = 2.0 * np.pi * 0.15 * np.arange(1, 6)
    shares = random.normal(size=(2, 5, joints)) / np.arange(1, 6)[:, None]
    wave = np.outer(time, pulse)
    wanted = np.sin(wave) @ shares[0] + np.cos(wave) @ shares[1]
    sines, cosines = pulse[:, None] * shares
    speed = np.cos(wave) @ sines - np.sin(wave) @ cosines
    scale = np.minimum(1.0 / np.abs(wanted).max(0), 2.0 / np.abs(speed).max(0))
    wanted, speed = wanted * scale, speed * scale
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = wanted[0], speed[0]
    inertia = np.zeros((joints, joints))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, inertia)
    kp, kd = 900.0 * np.diag(inertia), 45.0 * np.diag(inertia)
    positions, torques = np.empty_like(wanted), np.empty_like(wanted)
    for row in range(len(time)):
        torques[row] = kp * (wanted[row] - data.qpos) + kd * (speed[row] - data.qvel)
        positions[row] = data.qpos
        data.qfrc_applied[:] = torques[row]
        mujoco.mj_step(model, data, 2)
    level = np.std(torques, axis=0)
    positions += 1e-5 * random.normal(size=positions.shape)
    torques += 0.005 * level * random.normal(size=torques.shape)
    names = [f"joint_{joint}" for joint in range(joints)]
    (folder / "arm.xml").write_text(text, encoding="utf-8")
    bag = folder / f"{number}.mcap"
    states = JointTopic("/joint_states", names, time, positions, None, torques)
    write_bag(bag, [states, JointTopic("/joint_reference", names, time, wanted, speed)])
    configuration = Configuration.model_validate(
        {
            "robot": {"mjcf": folder / "arm.xml", "joints": names},
            "controller": {"type": "pd", "kp": list(kp), "kd": list(kd), "period": 1.0 / RATE},
            "signals": {"joint_states": "joint_states", "reference": "joint_reference"},
        }
    )
    result = identify([bag], configuration)
    assert result.physical is not None, result.why_no_physical
    bag.unlink()
    return result.physical


@pytest.mark.parametrize("number", [2, 12])
def test_the_divergence_from_the_nominal_model_outweighs_no_recording(number, tmp_path) -> None:
    """Arms of four and two joints that a tie-breaker of 0.1 called impossible."""
    test = rigid(number, tmp_path).test
    assert test.statistic is not None and test.df is not None
    assert test.statistic < 0.1 * test.df


@pytest.mark.slow
def test_no_more_rigid_arms_are_called_impossible_than_the_level_says(tmp_path: Path) -> None:
    """At 1 %, of 200 arms of two to seven joints, every second with a load nobody told of."""
    rejected = sum(not rigid(number, tmp_path).test.accepted for number in range(ARMS))
    assert rejected <= binom.ppf(0.99, ARMS, 0.01)
