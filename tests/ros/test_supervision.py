"""Whether a robot follows, on motions whose place at every time is known."""

import numpy as np
import pytest

from idim_iv_ros.excitation import Trajectory
from idim_iv_ros.nodes.collector.following import Supervision

RATE, SECONDS = 200.0, 4.0
LIMIT = 0.1  # rad


def places(time: np.ndarray) -> np.ndarray:
    """Two joints that swing by 0.6 and 0.3 rad within 4 s, at rest at both ends."""
    phase = 2.0 * np.pi * np.clip(time, 0.0, SECONDS) / SECONDS
    return np.column_stack([0.3 * (1.0 - np.cos(phase)), 0.15 * (np.cos(phase) - 1.0)])


@pytest.fixture
def motion() -> Trajectory:
    time = np.arange(round(RATE * SECONDS) + 1) / RATE
    position = places(time)
    velocity = np.gradient(position, 1.0 / RATE, axis=0)
    return Trajectory(("a", "b"), RATE, position, velocity, np.zeros_like(position))


def watched(motion: Trajectory, at, longest: float = 1.0) -> list[tuple[float, float, str]]:
    """Time, deviation and joint while the robot is at `at(time)`."""
    watch = Supervision(motion, at(0.0), LIMIT, longest)
    looks = []
    time = 0.0
    while not watch.ended(time):
        looks.append((time, *watch.look(time, at(time))))
        time += 0.02
    return looks


def first_beyond(looks: list[tuple[float, float, str]]) -> tuple[float, str]:
    return next((time, joint) for time, size, joint in looks if size > LIMIT)


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.8])
def test_robot_that_begins_late_and_sags_follows(motion, delay: float) -> None:
    sag = np.array([0.02, -0.01])
    looks = watched(motion, lambda time: places(np.array([time - delay]))[0] + sag)
    assert max(size for _, size, _ in looks) < 0.05


def test_robot_that_does_not_move_is_noticed_after_the_longest_delay(motion) -> None:
    """The first joint should be 0.1 rad away 0.54 s after it begins (cosine), at 1.54 s."""
    time, joint = first_beyond(watched(motion, lambda time: np.zeros(2)))
    assert joint == "a"
    begun = SECONDS / (2.0 * np.pi) * np.arccos(1.0 - LIMIT / 0.3)
    assert time == pytest.approx(1.0 + begun, abs=0.05)


def test_robot_that_is_held_up_is_noticed_when_it_is_the_limit_behind(motion) -> None:
    """Held at 0.3 rad after 1 s, where the speed is 0.47 rad/s; 0.1 s of slack are 0.05 rad."""
    looks = watched(motion, lambda time: places(np.array([min(time, 1.0)]))[0])
    time, joint = first_beyond(looks)
    assert joint == "a"
    assert 1.0 < time < 1.5


def test_robot_that_goes_elsewhere_is_noticed(motion) -> None:
    _, joint = first_beyond(watched(motion, lambda time: places(np.array([time]))[0] * [1, -2]))
    assert joint == "b"


def test_before_the_robot_moves_it_is_held_where_the_motion_begins(motion) -> None:
    watch = Supervision(motion, np.zeros(2), LIMIT, 10.0)
    watch.look(2.0, np.zeros(2))
    position, velocity = watch.planned(2.0)
    assert np.array_equal(position, motion.position[0])
    assert not velocity.any()


def test_end_of_a_motion_that_is_too_small_to_be_seen_is_not_waited_for(motion) -> None:
    small = Trajectory(motion.joints, RATE, *(0.05 * item for item in (
        motion.position, motion.velocity, motion.acceleration)))  # fmt: skip
    watch = Supervision(small, np.zeros(2), LIMIT, 60.0)
    assert not watch.ended(SECONDS + 0.9)
    assert watch.ended(SECONDS + 1.1)
    assert not Supervision(motion, np.zeros(2), LIMIT, 60.0).ended(SECONDS + 59.0)


def test_joint_that_is_held_up_is_the_one_that_is_named(motion) -> None:
    """Another delay would make the errors of both joints equal."""

    def at(time: float) -> np.ndarray:
        place = places(np.array([time]))[0]
        return np.array([min(place[0], 0.1), place[1]])

    _, joint = first_beyond(watched(motion, at))
    assert joint == "a"
