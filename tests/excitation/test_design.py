"""Motions for identification: limits, periods, rest, what they are good for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BPoly

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.design import (
    DesignSettings,
    ExcitationCost,
    condition_numbers,
    design_excitation,
    predict_parameters,
)
from idim_iv_ros.excitation.limits import motion_limits, moving_frames
from idim_iv_ros.excitation.trajectory import FourierBasis
from tests.excitation.conftest import FLOOR, SETTINGS
from tests.excitation.independent import assert_limits_hold, assert_signals_agree, lowest, torques


def test_every_limit_holds_at_every_sample(arm2, design) -> None:
    _, model, limits = arm2
    assert_limits_hold(model, limits, design.trajectory)
    assert_signals_agree(design.trajectory)


def test_reported_use_is_that_of_pinocchio(arm2, design) -> None:
    _, model, limits = arm2
    expected = np.abs(torques(model, design.trajectory)).max(axis=0) / limits.torque
    np.testing.assert_allclose(design.use.torque, expected, rtol=1e-9)
    assert design.use.lowest_height == pytest.approx(lowest(model, design.trajectory), abs=1e-9)
    assert design.use.lowest_height > FLOOR


def test_torque_limit_binds_where_it_is_small(robots) -> None:
    configuration, model = robots("arm2")
    free = motion_limits(model, configuration)
    limits = replace(free, torque=0.22 * free.torque)
    weak = design_excitation(model, limits, replace(SETTINGS, harmonics=3))
    assert_limits_hold(model, limits, weak.trajectory)
    assert weak.use.torque.max() > 0.8


def test_periods_repeat_and_meet_at_rest(design) -> None:
    motion, samples = design.trajectory, round(SETTINGS.period * SETTINGS.rate)
    assert len(motion.position) == SETTINGS.repeats * samples + 1
    np.testing.assert_array_equal(motion.position[:samples], motion.position[samples:-1])
    for sample in (0, samples, -1):
        np.testing.assert_allclose(motion.velocity[sample], 0.0, atol=1e-9)
        np.testing.assert_allclose(motion.acceleration[sample], 0.0, atol=1e-9)
        np.testing.assert_allclose(motion.position[sample], motion.position[0], atol=1e-12)


def test_quintics_between_points_of_the_message_follow_the_motion(design) -> None:
    motion, step = design.trajectory, round(SETTINGS.rate / 20.0)
    knots = [s[::step] for s in (motion.position, motion.velocity, motion.acceleration)]
    quintics = BPoly.from_derivatives(motion.time[::step], np.stack(knots, axis=1))
    assert np.abs(quintics(motion.time) - motion.position).max() < 1e-6


def test_condition_numbers_are_those_of_the_regressor(arm2, design) -> None:
    _, model, limits = arm2
    motion = design.period
    matrix = model.matrix(motion.position, motion.velocity, motion.acceleration)
    plain = matrix.reshape(-1, matrix.shape[2])
    weighted = (matrix / limits.torque[:, None]).reshape(plain.shape)
    unit = weighted / np.linalg.norm(weighted, axis=0)
    assert design.after.plain == pytest.approx(np.linalg.cond(plain), rel=1e-6)
    assert design.after.weighted == pytest.approx(np.linalg.cond(weighted), rel=1e-6)
    assert design.after.equilibrated == pytest.approx(np.linalg.cond(unit), rel=1e-6)


def test_precision_gives_smaller_deviations_than_the_condition_number(arm2, design) -> None:
    """Deviations of least squares by numpy; the motion of least condition number is slower."""
    _, model, limits = arm2
    precise = design_excitation(model, limits, replace(SETTINGS, criterion="precision"))
    deviations = []
    for made in (design, precise):
        motion = made.period
        matrix = model.matrix(motion.position, motion.velocity, motion.acceleration)
        rows = (matrix / limits.torque[:, None]).reshape(-1, matrix.shape[2])
        covariance = np.linalg.inv(rows.T @ rows)
        deviations.append(np.sqrt(np.diag(covariance)))
        size = np.linalg.slogdet(covariance)[1] / (2 * matrix.shape[2])
        assert made.after.deviation == pytest.approx(np.sqrt(len(matrix)) * np.exp(size), rel=1e-6)
        assert made.use.within(limits)
    assert precise.after.deviation < 0.8 * design.after.deviation
    ratio = deviations[1] / deviations[0]
    assert np.median(ratio) < 0.9
    assert np.sum(ratio < 1.0) >= 10
    assert design.after.weighted < precise.after.weighted


def test_design_beats_random_motions(design) -> None:
    assert design.after.weighted < 0.7 * design.before.weighted
    assert not design.ended_early


def test_time_limit_is_reported_and_limits_still_hold(arm2) -> None:
    _, model, limits = arm2
    hurried = design_excitation(model, limits, replace(SETTINGS, time_limit=1e-3))
    assert hurried.ended_early
    assert_limits_hold(model, limits, hurried.trajectory)


def test_start_posture_is_kept(robots) -> None:
    configuration, model = robots("double_pendulum")
    limits = motion_limits(model, configuration)
    start = np.array([0.3, -0.4])
    made = design_excitation(model, limits, replace(SETTINGS, harmonics=3, start=start))
    np.testing.assert_allclose(made.trajectory.position[[0, -1]], [start, start], atol=1e-12)


@pytest.mark.parametrize("criterion", ["condition", "precision"])
def test_gradient_is_that_of_finite_differences(robots, criterion) -> None:
    configuration, model = robots("arm6")
    limits = motion_limits(model, configuration, floor=0.3)
    limits = replace(limits, torque=0.2 * limits.torque)
    basis = FourierBasis(10.0, 3)
    cost = ExcitationCost(
        model=model,
        limits=limits,
        frames=moving_frames(model.robot),
        shapes=basis.shapes(np.arange(40) * 0.25),
        row_weights=1.0 / limits.torque,
        start=None,
        power=2.0,
        weight=3.0,
        criterion=criterion,
    )
    random = np.random.default_rng(4)
    x = random.normal(size=6 * (1 + basis.size)) * 0.4
    direction = random.normal(size=len(x))
    _, gradient = cost(x)
    step = 1e-6
    slope = (cost(x + step * direction)[0] - cost(x - step * direction)[0]) / (2.0 * step)
    assert gradient @ direction == pytest.approx(slope, rel=1e-4)


def test_predicted_deviations_are_those_of_least_squares(arm2, design) -> None:
    """Against the scatter of 400 fits under the noise that is assumed."""
    _, model, limits = arm2
    noise, motion = 0.01, design.period
    predicted = predict_parameters(model, motion, SETTINGS.repeats, limits.torque, noise)
    matrix = model.matrix(motion.position, motion.velocity, motion.acceleration)
    weighted = (matrix / (noise * limits.torque[:, None])).reshape(-1, matrix.shape[2])
    weighted = np.tile(weighted, (SETTINGS.repeats, 1))
    errors = np.random.default_rng(0).normal(size=(len(weighted), 400))
    scatter = np.linalg.lstsq(weighted, errors, rcond=None)[0].std(axis=1)
    by_name = {parameter.name: parameter.std for parameter in predicted}
    deviations_by_name = np.array([by_name[name] for name in model.base.names])
    np.testing.assert_allclose(deviations_by_name, scatter, rtol=0.15)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"harmonics": 1}, "harmonics"),
        ({"period": -1.0}, "period"),
        ({"period": 8.001}, "whole number of samples"),
        ({"rate": float("nan")}, "samples per second"),
        ({"rate": 4.0}, "harmonics of 8 s need"),
        ({"repeats": 0}, "repeats"),
        ({"time_limit": 0.0}, "time limit"),
        ({"start": np.array([0.0])}, "1 values for 2 joints"),
        ({"start": np.array([0.0, 3.0])}, "start of joint joint_2, 3, lies outside"),
    ],
)
def test_settings_that_cannot_be_are_one_line(arm2, change, complaint: str) -> None:
    _, model, limits = arm2
    with pytest.raises(UsageError, match=complaint):
        design_excitation(model, limits, replace(SETTINGS, **change))


@pytest.mark.slow
@pytest.mark.parametrize("floor", [None, 0.05])
def test_seven_joints_reach_the_published_condition_number(robots, floor) -> None:
    configuration, model = robots("arm7")
    limits = motion_limits(model, configuration, floor=floor)
    made = design_excitation(model, limits, DesignSettings(rate=200.0, time_limit=600.0))
    assert made.after.plain <= 116.7
    assert made.after.weighted <= 116.7
    assert_limits_hold(model, limits, made.period)
    assert condition_numbers(model, made.period, limits.torque) == made.after
