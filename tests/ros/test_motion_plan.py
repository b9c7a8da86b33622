"""Which joint trajectories the simulated robot plays, and which it refuses."""

import numpy as np
import pytest

from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.simulator.playback import commanded

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
