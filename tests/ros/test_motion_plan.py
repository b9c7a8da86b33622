"""Which joint trajectories the simulated robot plays, and which it refuses."""

import numpy as np
import pytest

from idim_iv_ros import load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation import Trajectory
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
    with pytest.raises(UsageError, match=words) as refused:
        commanded(JOINTS, np.array(times), np.array(places), velocities, RATE)
    assert "\n" not in str(refused.value)


def test_motion_that_takes_the_place_of_another_goes_on_from_it_without_a_step() -> None:
    configuration = load_configuration(ROOT / "config" / "arm2.yaml")
    urdf = configuration.robot.urdf
    robot = simulated_robot(configuration, urdf.read_text(), urdf.name)
    joints = tuple(configuration.robot.joints)
    time = np.arange(2001) / RATE
    places = np.column_stack([0.5 * (1.0 - np.cos(np.pi * time / 2.0)), 0.0 * time])
    speeds = np.gradient(places, 1.0 / RATE, axis=0)
    swing = Trajectory(joints, RATE, places, speeds, np.zeros_like(places))
    simulation = MotionSimulation(configuration, robot, RATE)
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
