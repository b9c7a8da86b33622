"""The motion of a collector, and whether the robot follows it."""

import numpy as np
import pytest

from idim_iv_ros import load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.nodes.collector.collection import Supervision
from idim_iv_ros.nodes.simulator.playback import REST as RESTING
from idim_iv_ros.nodes.simulator.playback import MotionSimulation, commanded
from idim_iv_ros.simulators.recording import simulated_robot
from tests.ros.processes import ROOT

RATE = 1000.0  # Hz
JOINTS = ["a", "b"]
REST = [[0.0, 0.0], [0.0, 0.0]]


def test_points_are_met_with_their_velocities() -> None:
    times, places = np.array([0.5, 1.0, 2.0]), np.array([[0.0, 1.0], [0.2, 0.9], [0.5, 0.0]])
    speeds = np.array([[0.0, 0.0], [0.3, -0.4], [0.0, 0.0]])
    trajectory = commanded(JOINTS, times, places, speeds, RATE)
    assert len(trajectory.position) == 1501
    assert np.allclose(trajectory.position[[0, 500, 1500]], places)
    assert np.allclose(trajectory.velocity[[0, 500, 1500]], speeds)


def test_points_without_velocities_are_joined_by_lines() -> None:
    places = np.array([[0.0, 0.0], [1.0, -2.0]])
    trajectory = commanded(JOINTS, np.array([0.0, 2.0]), places, None, RATE)
    assert np.allclose(trajectory.position[500], [0.25, -0.5])
    assert np.allclose(trajectory.velocity[500], [0.5, -1.0])


@pytest.mark.parametrize(
    ("times", "places", "speeds", "words"),
    [
        ([], [], None, "0 points"),
        ([1.0], [[0.0, 0.0]], None, "1 points"),
        ([1.0, 0.0], REST, None, "does not increase"),
        ([1.0, 1.0], REST, None, "does not increase"),
        ([-5.0, 1.0], REST, None, "does not increase"),
        ([0.0, 1e-9], REST, None, "shorter than one sample"),
        ([0.0, 2.0**31], REST, None, "longer than 3600 s"),
        ([0.0, 1.0], [[0.0, 0.0], [np.nan, 0.0]], None, "not finite"),
        ([0.0, 1.0], REST, [[0.0, 0.0], [np.inf, 0.0]], "not finite"),
    ],
)
def test_malformed_trajectory_is_one_line(times, places, speeds, words: str) -> None:
    velocities = None if speeds is None else np.array(speeds)
    with pytest.raises(UsageError, match=words):
        commanded(JOINTS, np.array(times), np.array(places), velocities, RATE)


def test_motion_that_takes_the_place_of_another_goes_on_from_it_without_a_step() -> None:
    configuration = load_configuration(ROOT / "config" / "arm2.yaml")
    robot = simulated_robot(configuration)
    joints = tuple(configuration.robot.joints)
    time = np.arange(2001) / RATE
    places = np.column_stack([0.5 * (1.0 - np.cos(np.pi * time / 2.0)), 0.0 * time])
    speeds = np.gradient(places, 1.0 / RATE, axis=0)
    swing = Trajectory(joints, RATE, places, speeds, np.zeros_like(places))
    simulation = MotionSimulation(robot, RATE)
    before, references = simulation.published(np.zeros(2), swing, seed=1)
    change = 1500  # a second into the swing, behind half a second of approach: at 0.5 rad
    assert references[change][0] == pytest.approx(0.5, abs=0.01)
    end = np.array([[0.6, 0.1], [0.6, 0.1]])
    stop = Trajectory(joints, RATE, end, np.zeros((2, 2)), np.zeros((2, 2)))
    history = references[: change + 1]
    after, changed = simulation.continued(history, 0.1, stop, seed=1)
    assert np.array_equal(changed[: change + 1], history)
    assert np.allclose(changed[-1], [0.6, 0.1])
    fastest = np.abs(speeds).max() / RATE
    assert np.abs(np.diff(changed, axis=0)).max() <= 1.01 * fastest
    # The second joint goes 0.1 rad from rest to rest in 0.3 s, a cubic: 6 x / T² at its ends.
    assert np.abs(np.diff(changed, 2, axis=0)).max() * RATE**2 < 1.05 * 6.0 * 0.1 / 0.3**2
    assert len(changed) < len(references)
    assert len(changed) > change + RATE * RESTING
    same = after[0].time < change / RATE
    assert np.allclose(after[0].position[same], before[0].position[: same.sum()], atol=2e-4)


STEPS, SECONDS = 200.0, 4.0
LIMIT = 0.1  # rad


BEGUN = SECONDS / (2.0 * np.pi) * np.arccos(1.0 - LIMIT / 0.3)  # s until it should be 0.1 rad away


def places(time: np.ndarray | float) -> np.ndarray:
    """Two joints that swing by 0.6 and 0.3 rad within 4 s, at rest at both ends."""
    phase = 2.0 * np.pi * np.clip(time, 0.0, SECONDS) / SECONDS
    return np.stack([0.3 * (1.0 - np.cos(phase)), 0.15 * (np.cos(phase) - 1.0)], axis=-1)


@pytest.fixture
def motion() -> Trajectory:
    time = np.arange(round(STEPS * SECONDS) + 1) / STEPS
    position = places(time)
    velocity = np.gradient(position, 1.0 / STEPS, axis=0)
    return Trajectory(("a", "b"), STEPS, position, velocity, np.zeros_like(position))


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
    small = Trajectory(motion.joints, STEPS, *(0.05 * item for item in (
        motion.position, motion.velocity, motion.acceleration)))  # fmt: skip
    watch = Supervision(small, np.zeros(2), LIMIT, 60.0)
    assert not watch.ended(SECONDS + 0.9)
    assert watch.ended(SECONDS + 1.1)
    assert not Supervision(motion, np.zeros(2), LIMIT, 60.0).ended(SECONDS + 59.0)
