"""The way to a motion, through it slowly, and to rest again, against SciPy and the limits."""

from pathlib import Path

import numpy as np
import pytest

from idim_iv_ros import load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.excite import passes_of, plan_passes, slowed, stop
from idim_iv_ros.excitation.limits import MotionLimits

ARM2 = Path(__file__).resolve().parents[2] / "config" / "arm2.yaml"


@pytest.fixture(scope="module")
def planned():
    return plan_passes(
        load_configuration(ARM2), kind="random", duration=6.0, speed_scale=0.5, seed=3
    )


def test_motion_keeps_the_scaled_limits_and_rests_at_both_ends(planned) -> None:
    _, limits, motion = planned
    assert np.allclose(limits.velocity, [2.0, 3.0])  # half of the URDF's 4 and 6 rad/s
    assert np.all(np.abs(motion.velocity).max(axis=0) <= limits.velocity)
    assert motion.duration == pytest.approx(6.0)
    for end in (0, -1):
        assert np.allclose(motion.position[end], motion.position[0], atol=1e-9)
        assert np.allclose(motion.velocity[end], 0.0, atol=1e-9)


def test_one_seed_gives_one_motion(planned) -> None:
    configuration = load_configuration(ARM2)
    given = {"kind": "random", "duration": 6.0, "speed_scale": 0.5}
    again = plan_passes(configuration, seed=3, **given)[2]
    other = plan_passes(configuration, seed=4, **given)[2]
    assert np.array_equal(again.position, planned[2].position)
    assert not np.allclose(other.position, planned[2].position)


def test_approach_goes_from_rest_to_rest_within_its_share_of_the_limits(planned) -> None:
    model, limits, motion = planned
    start = np.array([-1.5, 2.0])
    passes = passes_of(model, limits, motion, start, approach_speed=0.1, slow_speed=0.25)
    way = passes.approach
    assert np.allclose(way.position[0], start)
    assert np.allclose(way.position[-1], motion.position[0])
    assert np.allclose(way.velocity[[0, -1]], 0.0)
    assert np.all(np.abs(way.velocity).max(axis=0) <= 0.1 * limits.velocity * (1 + 1e-9))
    assert np.all(np.abs(way.acceleration).max(axis=0) <= 0.1 * limits.acceleration * (1 + 1e-9))
    step = 1.0 / way.rate
    assert np.allclose(np.gradient(way.position, step, axis=0), way.velocity, atol=1e-3)
    assert np.allclose(np.gradient(way.velocity, step, axis=0), way.acceleration, atol=1e-2)
    assert passes.slow.duration == pytest.approx(4.0 * motion.duration)


def test_slowed_motion_has_the_derivatives_of_its_path(planned) -> None:
    slow = slowed(planned[2], 0.25)
    step = 1.0 / slow.rate
    inner = slice(1, -1)
    numerical = np.gradient(slow.position, step, axis=0)
    assert np.allclose(numerical[inner], slow.velocity[inner], atol=1e-3)
    numerical = np.gradient(slow.velocity, step, axis=0)
    assert np.allclose(numerical[inner], slow.acceleration[inner], atol=1e-2)


def test_robot_outside_of_its_limits_is_not_moved(planned) -> None:
    model, limits, motion = planned
    with pytest.raises(UsageError, match=r"joint_2 is at 2\.7, outside"):
        passes_of(model, limits, motion, np.array([0.0, 2.7]), approach_speed=0.1, slow_speed=0.2)


def test_way_below_the_floor_is_refused(planned) -> None:
    """The first axis is 0.6 m above the base, the arm 0.78 m long: hanging it ends at -0.18 m."""
    configuration = load_configuration(ARM2)
    model, limits, motion = plan_passes(
        configuration, kind="random", duration=2.0, speed_scale=0.05, seed=1, floor=0.3
    )
    with pytest.raises(UsageError, match="below the floor"):
        passes_of(model, limits, motion, np.array([1.57, 0.0]), approach_speed=0.1, slow_speed=0.2)


@pytest.mark.parametrize(
    ("given", "words"),
    [({"duration": 0.5}, "1 to 1000 s"), ({"speed_scale": 0.0}, "above 0 and up to 1")],
)
def test_impossible_requests_are_refused(given: dict, words: str) -> None:
    values = {"kind": "random", "duration": 6.0, "speed_scale": 0.5, "seed": 1, **given}
    with pytest.raises(UsageError, match=words):
        plan_passes(load_configuration(ARM2), **values)


def limits_of(lower: float, upper: float) -> MotionLimits:
    return MotionLimits(
        lower=np.full(2, lower),
        upper=np.full(2, upper),
        velocity=np.full(2, 3.0),
        acceleration=np.array([10.0, 20.0]),
        torque=np.full(2, 50.0),
        torque_checked=True,
        floor=None,
        margin=0.9,
    )


def test_stop_takes_v_over_a_and_half_of_that_way() -> None:
    halt = stop(("a", "b"), np.array([0.1, 0.2]), np.array([2.0, -1.0]), limits_of(-3.0, 3.0))
    assert halt.duration == pytest.approx(0.2)  # 2 rad/s at 10 rad/s²; the other joint needs less
    assert np.allclose(halt.position[-1], [0.1 + 2.0 * 0.2 / 2, 0.2 - 1.0 * 0.2 / 2])
    assert np.allclose(halt.velocity[-1], 0.0)
    assert np.all(np.abs(halt.acceleration).max(axis=0) <= [10.0, 20.0])


def test_stop_does_not_leave_the_range() -> None:
    halt = stop(("a", "b"), np.array([0.9, 0.0]), np.array([2.0, 0.0]), limits_of(-1.0, 1.0))
    assert halt.position.max() <= 1.0
    assert np.allclose(halt.velocity[-1], 0.0)
