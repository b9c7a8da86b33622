"""Three simulated arms with a known truth that differs from their given values."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.model import DynamicParameters, RobotModel, load_robot
from idim_iv_ros.recording.writing.write import JointTopic
from idim_iv_ros.simulation import (
    ControlLaw,
    SimulatedRecording,
    control_law,
    record_simulated_robot,
)

FloatArray = NDArray[np.float64]

CONFIG = Path(__file__).parent.parent / "config"
BASE_FREQUENCY = 0.1
HARMONICS = (1, 2, 3, 5, 7)
RAMP = 2.0


@dataclass(frozen=True)
class SimulatedArm:
    """A robot, what it really is, and the motion that it is asked for.

    Attributes
    ----------
    configuration : Configuration
        With the given values (URDF, armature), which are not the truth.
    robot : RobotModel
    truth : DynamicParameters
        10 to 30 % off the given values, physically consistent.
    law : ControlLaw
        The configured one, without delay.
    position_reference, velocity_reference : (n_samples, n_joints)
        rad, rad/s.
    rate : float
        Hz.
    """

    configuration: Configuration
    robot: RobotModel
    truth: DynamicParameters
    law: ControlLaw
    position_reference: FloatArray
    velocity_reference: FloatArray
    rate: float


def arm2(*, seconds: float = 10.0, rate: float = 1000.0, seed: int = 1) -> SimulatedArm:
    """Planar arm, vertical plane."""
    return _arm("arm2", centre=[0.4, 0.5], seconds=seconds, rate=rate, seed=seed)


def arm6(*, seconds: float = 15.0, rate: float = 1000.0, seed: int = 1) -> SimulatedArm:
    """Six joints, offset shoulder and wrist."""
    centre = [0.0, 0.3, 0.9, 0.0, 0.6, 0.0]
    return _arm("arm6", centre=centre, seconds=seconds, rate=rate, seed=seed)


def arm7(*, seconds: float = 20.0, rate: float = 1000.0, seed: int = 1) -> SimulatedArm:
    """Seven joints, redundant."""
    centre = [0.0, 0.3, 0.0, -0.8, 0.0, 0.5, 0.0]
    return _arm("arm7", centre=centre, seconds=seconds, rate=rate, seed=seed)


def record(
    arm: SimulatedArm,
    seed: int,
    *,
    position_noise: float | FloatArray = 2e-5,
    torque_noise: float | Sequence[float] | None = None,
    encoder_resolution: float = 0.0,
    disturbance: float | FloatArray = 0.0,
    stamp_jitter: float = 0.0,
) -> SimulatedRecording:
    """Record an arm; noise in rad and N m (torque default: 0.5 % of each joint's limit)."""
    limits = np.asarray(arm.configuration.controller.torque_limit)
    return record_simulated_robot(
        arm.robot,
        arm.truth,
        arm.law,
        arm.position_reference,
        arm.velocity_reference,
        rate=arm.rate,
        seed=seed,
        position_noise=position_noise,
        torque_noise=0.005 * limits if torque_noise is None else np.asarray(torque_noise),
        encoder_resolution=encoder_resolution,
        disturbance=disturbance,
        stamp_jitter=stamp_jitter,
    )


def joint_topics(arm: SimulatedArm, recorded: SimulatedRecording) -> list[JointTopic]:
    """What a recorder would have written of it: joint states and reference."""
    joints, time = arm.configuration.robot.joints, recorded.time
    position, velocity = recorded.position_reference, recorded.velocity_reference
    return [
        JointTopic("/joint_states", joints, time, recorded.position, None, recorded.effort),
        JointTopic("/joint_reference", joints, time, position, velocity),
    ]


def _arm(
    name: str, *, centre: Sequence[float], seconds: float, rate: float, seed: int
) -> SimulatedArm:
    configuration = load_configuration(CONFIG / f"{name}.yaml")
    section = configuration.robot
    assert section.urdf is not None
    robot = load_robot(
        section.urdf.read_text(encoding="utf-8"),
        section.joints,
        gravity=section.gravity,
        armature=configuration.simulator.armature,
        source=section.urdf.name,
    )
    position, velocity = _fourier(robot, np.asarray(centre), seconds, rate, seed)
    return SimulatedArm(
        configuration=configuration,
        robot=robot,
        truth=_truth(robot.given),
        law=control_law(configuration.controller, len(section.joints)),
        position_reference=position,
        velocity_reference=velocity,
        rate=rate,
    )


def _truth(given: DynamicParameters) -> DynamicParameters:
    """Masses, inertias, drives and friction 10 to 30 % off, centres of mass up to 12 mm."""
    rng = np.random.default_rng(20)
    n = len(given.inertial)

    def off() -> FloatArray:
        return 1.0 + rng.uniform(0.1, 0.3, n) * rng.choice([-1.0, 1.0], n)

    mass, inertia, shift = off(), off(), rng.uniform(-0.012, 0.012, (n, 3))
    inertial = np.empty_like(given.inertial)
    for joint in range(n):
        link = pin.Inertia.FromDynamicParameters(given.inertial[joint])
        true_link = pin.Inertia(
            link.mass * mass[joint], link.lever + shift[joint], link.inertia * inertia[joint]
        )
        inertial[joint] = true_link.toDynamicParameters()
    return DynamicParameters(
        inertial=inertial,
        drive_inertia=given.drive_inertia * off(),
        viscous=given.viscous * off(),
        coulomb=given.coulomb * off(),
        offset=given.coulomb * rng.uniform(-0.2, 0.2, n),
        coupling_joints=given.coupling_joints,
        coupling_inertia=given.coupling_inertia,
        coupling_viscous=given.coupling_viscous,
        coupling_coulomb=given.coupling_coulomb,
    )


def _fourier(
    robot: RobotModel, centre: FloatArray, seconds: float, rate: float, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Sum of five sines and cosines per joint, faded in from rest, within the limits."""
    rng = np.random.default_rng(seed)
    time = np.arange(round(seconds * rate))[:, None] / rate
    pulsation = 2.0 * np.pi * BASE_FREQUENCY * np.array(HARMONICS)
    sines, cosines = rng.normal(size=(2, len(HARMONICS), len(centre))) / pulsation[:, None] ** 0.5
    wave, slope = np.zeros((2, len(time), len(centre)))
    for w, a, b in zip(pulsation, sines, cosines, strict=True):
        wave += a * np.sin(w * time) + b * np.cos(w * time)
        slope += w * (a * np.cos(w * time) - b * np.sin(w * time))
    s = np.clip(time / RAMP, 0.0, 1.0)
    fade = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    fade_slope = 30.0 * s**2 * (1.0 - s) ** 2 / RAMP
    wave, slope = fade * wave, fade * slope + fade_slope * wave
    limits = robot.limits
    room = np.minimum(limits.upper - centre, centre - limits.lower)
    scale = np.minimum(
        0.8 * room / np.abs(wave).max(axis=0), 0.7 * limits.velocity / np.abs(slope).max(axis=0)
    )
    return centre + scale * wave, scale * slope
