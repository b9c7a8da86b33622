"""Whether a robot follows, on motions whose place at every time is known."""

import numpy as np
import pytest

from idim_iv_ros.excitation import Trajectory
from idim_iv_ros.nodes.collector.following import Supervision

RATE, SECONDS = 200.0, 4.0
LIMIT = 0.1  # rad


BEGUN = SECONDS / (2.0 * np.pi) * np.arccos(1.0 - LIMIT / 0.3)  # s until it should be 0.1 rad away


def places(time: np.ndarray | float) -> np.ndarray:
    """Two joints that swing by 0.6 and 0.3 rad within 4 s, at rest at both ends."""
    phase = 2.0 * np.pi * np.clip(time, 0.0, SECONDS) / SECONDS
    return np.stack([0.3 * (1.0 - np.cos(phase)), 0.15 * (np.cos(phase) - 1.0)], axis=-1)


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


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.8])
def test_robot_that_begins_late_and_sags_follows(motion, delay: float) -> None:
    sag = np.array([0.02, -0.01])
    looks = watched(motion, lambda time: places(time - delay) + sag)
    assert max(size for _, size, _ in looks) < 0.05


@pytest.mark.parametrize(
    ("at", "joint", "earliest", "latest"),
    [
        # The longest delay, 1 s, is waited for.
        pytest.param(lambda time: np.zeros(2), "a", 0.95 + BEGUN, 1.05 + BEGUN, id="does not move"),
        # Held at 0.3 rad, where the speed is 0.47 rad/s; 0.1 s of slack are 0.05 rad.
        pytest.param(lambda time: places(min(time, 1.0)), "a", 1.0, 1.5, id="is held up"),
        pytest.param(lambda time: places(time) * [1, -2], "b", 0.0, SECONDS, id="goes elsewhere"),
        # Another delay would make the errors of both joints equal.
        pytest.param(
            lambda time: np.minimum(places(time), [0.1, 1.0]), "a", 0.0, SECONDS, id="one joint"
        ),
    ],
)
def test_robot_that_does_not_follow_is_noticed_in_time(
    motion, at, joint: str, earliest: float, latest: float
) -> None:
    looks = watched(motion, at)
    time, named = next((time, joint) for time, size, joint in looks if size > LIMIT)
    assert named == joint
    assert earliest < time < latest


def test_end_of_a_motion_that_is_too_small_to_be_seen_is_not_waited_for(motion) -> None:
    small = Trajectory(motion.joints, RATE, *(0.05 * item for item in (
        motion.position, motion.velocity, motion.acceleration)))  # fmt: skip
    watch = Supervision(small, np.zeros(2), LIMIT, 60.0)
    assert not watch.ended(SECONDS + 0.9)
    assert watch.ended(SECONDS + 1.1)
    assert not Supervision(motion, np.zeros(2), LIMIT, 60.0).ended(SECONDS + 59.0)
