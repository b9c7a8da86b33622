"""Limits from URDF, configuration and request; heights of frames."""

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.excite import load_model, servo_motion
from idim_iv_ros.excitation.limits import motion_limits, moving_frames, require_reachable
from idim_iv_ros.excitation.trajectory import require_sampling
from idim_iv_ros.model import JointLimits
from tests.fuzz.case import CONFIG
from tests.inputs import changed


def without(model, **changes):
    limits = JointLimits(**{**model.robot.limits.__dict__, **changes})
    return replace(model, robot=replace(model.robot, limits=limits))


def test_default_acceleration_is_half_the_torque_on_the_inertia_or_full_speed_in_100_ms(robots):
    configuration, model = robots("arm2")
    limits = motion_limits(model, configuration)
    np.testing.assert_allclose(limits.acceleration[1], 10.0 * limits.velocity[1])
    data = model.robot.pinocchio.createData()
    mean = np.mean(
        [
            pin.crba(model.robot.pinocchio, data, np.array([0.0, q]))[0, 0]
            for q in np.linspace(-2.6, 2.6, 400)
        ]
    )
    inertia = mean + model.robot.given.drive_inertia[0]
    expected = min(40.0, 0.5 * 90.0 / inertia)
    assert limits.acceleration[0] == pytest.approx(expected, rel=0.05)


def test_torque_limit_is_the_smaller_of_urdf_and_controller(robots) -> None:
    configuration, model = robots("arm2")
    smaller = changed(configuration, "controller", torque_limit=[100.0, 20.0])
    np.testing.assert_array_equal(motion_limits(model, smaller).torque, [90.0, 20.0])


def test_continuous_joints_get_half_a_turn_each_way(robots) -> None:
    configuration, model = robots("double_pendulum")
    limits = motion_limits(model, configuration)
    np.testing.assert_allclose(limits.lower, -np.pi)
    np.testing.assert_allclose(limits.upper, np.pi)


@pytest.mark.parametrize(
    ("name", "change", "complaint"),
    [
        ("arm2", {"velocity": np.array([4.0, np.inf])}, "joint_2 has no velocity limit"),
        ("arm2", {"velocity": np.array([0.0, 6.0])}, "joint_1 has no velocity limit"),
        ("double_pendulum", {"effort": np.array([np.inf, 10.0])}, r"shoulder .*torque_limit"),
        ("emps", {"lower": np.array([-np.inf]), "upper": np.array([np.inf])}, "axis has no pos"),
    ],
)
def test_missing_limit_names_the_joint(robots, name: str, change, complaint: str) -> None:
    configuration, model = robots(name)
    with pytest.raises(UsageError, match=complaint):
        motion_limits(without(model, **change), configuration)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"margin": 0.0}, "margin"),
        ({"margin": 1.1}, "margin"),
        ({"margin": float("nan")}, "margin"),
        ({"acceleration": [1.0, 2.0, 3.0]}, "3 values for 2 joints"),
        *(({"acceleration": [value]}, "rad/s²") for value in (-1.0, 0.0, 1e-300, 1e300, np.nan)),
        ({"floor": float("inf")}, "floor"),
    ],
)
def test_values_outside_their_range_are_refused(robots, arguments, complaint: str) -> None:
    configuration, model = robots("arm2")
    with pytest.raises(UsageError, match=complaint):
        motion_limits(model, configuration, **arguments)


@pytest.mark.parametrize("name", ["arm6", "emps", "double_pendulum"])
def test_heights_are_those_of_pinocchio(robots, name: str) -> None:
    _, model = robots(name)
    robot, frames = model.robot, moving_frames(model.robot)
    q = np.random.default_rng(2).uniform(-1.0, 1.0, (5, len(robot.joints)))
    heights = frames.heights(q)
    data = robot.pinocchio.createData()
    for sample, posture in enumerate(q[:, robot.order]):
        pin.framesForwardKinematics(robot.pinocchio, data, posture)
        for place, frame in enumerate(frames.names):
            index = robot.pinocchio.getFrameId(frame)
            assert heights[sample, place] == pytest.approx(data.oMf[index].translation[2])


def test_floor_out_of_reach_names_the_frame(robots) -> None:
    configuration, model = robots("arm6")
    limits, frames = motion_limits(model, configuration), moving_frames(model.robot)
    require_reachable(frames, replace(limits, floor=0.05))
    with pytest.raises(UsageError, match=r"floor 0\.5 m .* joint_1"):
        require_reachable(frames, replace(limits, floor=0.5))


@pytest.fixture(scope="module")
def configuration():
    return load_configuration(CONFIG / "arm2.yaml")


@pytest.mark.parametrize(
    ("rate", "duration", "words"),
    [
        *((rate, 10.0, "samples per second") for rate in (0.0, -1.0, 1e-300, 1e300, math.nan)),
        *((1000.0, seconds, "motion lasts") for seconds in (0.0, -1.0, 1e9, math.inf, math.nan)),
    ],
)
def test_sampling_that_cannot_be_computed_is_refused(rate, duration, words) -> None:
    with pytest.raises(UsageError, match=words):
        require_sampling(rate, duration, "the motion")


def test_motion_for_servos_uses_its_limits_and_keeps_them() -> None:
    configuration = load_configuration(CONFIG / "arm6.yaml")
    limits = motion_limits(load_model(configuration), configuration)
    motion, highest, document = servo_motion(configuration, limits, rate=100.0, seed=1)
    assert motion.duration == 20.0 and highest == 2.0 and document["purpose"] == "servo"
    assert (motion.position >= limits.lower).all() and (motion.position <= limits.upper).all()
    speed, acceleration = np.abs(motion.velocity), np.abs(motion.acceleration)
    assert (speed <= limits.velocity).all() and (acceleration <= limits.acceleration).all()
    np.testing.assert_allclose(motion.velocity[[0, -1]], 0.0, atol=1e-9)
    assert ((np.diff(np.sign(motion.velocity), axis=0) != 0).sum(axis=0) >= 10).all()
