"""The servo's numbers come back from MuJoCo's recordings, which this program did not simulate."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.servos import (
    LENGTH,
    LIMIT,
    MASS,
    TRUTH,
    URDF,
    mujoco_servo,
    with_gain,
    with_load,
)
from idim_iv_ros.model.robot import load_robot
from idim_iv_ros.servo.fit import fit_factor, fit_servos, ordinary_least_squares
from idim_iv_ros.servo.identify import absolute_numbers, is_absolute, ratio_numbers
from idim_iv_ros.servo.loop_kernel import Drive

TRUE = TRUTH | {"torque limit": LIMIT}


@pytest.fixture(scope="module")
def fitted(motion):
    ((runs, answer),) = fit_servos([motion], load_robot(URDF, ["j"]))
    return runs, answer


def numbers_of(answer):
    numbers = (*absolute_numbers(answer, 0.0), *ratio_numbers(answer, with_links=False))
    return {number.name: number for number in numbers}


@pytest.mark.parametrize("name", TRUE)
def test_number_is_near_the_truth_and_its_interval_is_short(fitted, name):
    number = numbers_of(fitted[1])[name]
    assert number.shown
    assert number.value == pytest.approx(TRUE[name], rel=0.05)
    assert number.low < TRUE[name] * 1.01 and number.high > TRUE[name] * 0.99
    assert number.high - number.low < 0.25 * TRUE[name]


def test_residual_is_the_rounding_of_the_encoder(fitted):
    assert fitted[1].residual == pytest.approx(2.0 * np.pi / 4096 / np.sqrt(12.0), rel=0.1)


def test_the_true_drive_moves_as_mujoco_does(motion, fitted):
    stiffness = TRUE["stiffness"]
    drive = Drive(
        1.0 / stiffness,
        TRUE["armature"] / stiffness,
        TRUE["damping"] / stiffness,
        TRUE["dry friction"] / stiffness,
        0.0,
        TRUE["delay"],
        LIMIT / stiffness,
        0.0,
    )
    left = (motion.position - fitted[0][0].simulated(drive))[fitted[0][0].used]
    assert np.sqrt(np.mean(left**2)) < 0.6e-3  # of which rounding is 0.44e-3


def test_least_squares_on_measured_motion_is_biased(fitted):
    run = fitted[0][0]
    most = 0.9 * LIMIT / TRUE["stiffness"]
    inside = replace(run, valid=run.valid & (np.abs(run.command - run.position) < most))
    plain = ordinary_least_squares([inside], delay=TRUE["delay"])
    assert plain.inertia / plain.compliance < 0.95 * TRUE["armature"]


@pytest.mark.parametrize(
    ("gain", "kind", "expected"), [(2.0, with_gain, 0.5), (1.0, with_load, 1.0)]
)
def test_gain_or_load_of_a_run_is_told(fitted, gain, kind, expected):
    runs, answer = fitted
    factor, std = fit_factor(kind(replace(runs[0], gain=gain)), answer)
    assert factor == pytest.approx(expected, abs=max(3.0 * std, 0.01))


def test_without_gravity_only_ratios_are_known():
    motion = mujoco_servo(100.0, 12.0, seed=5, gravity=0.0)
    upright = URDF.replace('xyz="0 1 0"', 'xyz="0 0 1"')
    ((_, answer),) = fit_servos([motion], load_robot(upright, ["j"]))
    assert not is_absolute(answer)
    stiffness, inertia = TRUE["stiffness"], MASS * LENGTH**2 + TRUE["armature"]
    assert answer.drive.damping == pytest.approx(TRUE["damping"] / stiffness, rel=0.02)
    both = answer.drive.compliance * MASS * LENGTH**2 + answer.drive.inertia
    assert both == pytest.approx(inertia / stiffness, rel=0.02)


def test_at_30_hz_the_rate_of_learning_data(fitted):
    ((_, answer),) = fit_servos([mujoco_servo(25.0, 30.0, seed=7)], load_robot(URDF, ["j"]))
    numbers = numbers_of(answer)
    for name in ("stiffness", "armature", "damping", "delay"):
        assert numbers[name].value == pytest.approx(TRUE[name], rel=0.1)
