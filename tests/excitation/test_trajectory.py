"""Trajectories in files: CSV there and back, YAML that becomes a ROS 2 message."""

import io
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore
from ruamel.yaml import YAML

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.excite import write_joint_trajectory
from idim_iv_ros.excitation.trajectory import Trajectory, read_trajectory, write_csv

STORE = get_typestore(Stores.ROS2_JAZZY)
KIND = "trajectory_msgs/msg/JointTrajectory"


def wave(rate: float = 100.0, seconds: float = 1.97) -> Trajectory:
    time = np.arange(round(seconds * rate) + 1)[:, None] / rate
    w = np.array([1.0, 2.0])
    return Trajectory(
        ("shoulder", "elbow"),
        rate,
        np.sin(w * time),
        w * np.cos(w * time),
        -(w**2) * np.sin(w * time),
    )


def in_csv(trajectory: Trajectory, path: Path) -> Path:
    with path.open("w") as file:
        write_csv(trajectory, file)
    return path


def test_csv_returns_what_was_written(tmp_path: Path) -> None:
    written = wave()
    read = read_trajectory(in_csv(written, tmp_path / "t.csv"))
    assert (read.joints, read.rate) == (written.joints, written.rate)
    for name in ("position", "velocity", "acceleration", "time"):
        np.testing.assert_allclose(getattr(read, name), getattr(written, name), atol=1e-9)


def test_missing_derivatives_are_differentiated(tmp_path: Path) -> None:
    written = wave(rate=1000.0)
    path = tmp_path / "t.csv"
    table = np.column_stack([written.time, written.position])
    np.savetxt(
        path, table, delimiter=",", header="time,shoulder.position,elbow.position", comments=""
    )
    read = read_trajectory(path)
    np.testing.assert_allclose(read.velocity, written.velocity, atol=1e-5)
    np.testing.assert_allclose(read.acceleration, written.acceleration, atol=1e-2)
    np.testing.assert_allclose(read.acceleration[5:-5], written.acceleration[5:-5], atol=1e-4)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "no row of a table"),
        ("time,a.position\n0,1\n1,2\n", "2 samples"),
        ("a.position\n0\n1\n2\n", "columns time"),
        ("time,a.position\n0,1\n1,x\n2,3\n", "a.position holds 'x'"),
        ("time,a.position\n0,1\n1,2,5\n2,3\n", "a row of 3 columns"),
        ("time,a.position\n0,1\n1,2\n3,3\n4,3\n", "not uniform"),
        ("time,a.position\n0,1\n0,2\n0,3\n", "do not increase"),
        ("time,a.position,a.position\n0,1,1\n1,2,2\n2,3,3\n", "2 columns are named a.position"),
        (
            "time,a.position,b.position,a.velocity\n0,1,1,1\n1,2,2,1\n2,3,3,1\n",
            "b.velocity is missing",
        ),
    ],
)
def test_bad_file_is_one_line(text: str, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match=complaint) as caught:
        read_trajectory(path)
    assert str(path) in str(caught.value)


def message(document):
    """The message that ros2 topic pub makes of a document, whose keys are its fields."""
    types = STORE.types
    fields = ("positions", "velocities", "accelerations", "effort", "time_from_start")
    points = []
    for entry in document["points"]:
        assert set(entry) == set(fields)
        numbers = [entry[name] for name in fields[:-1]]
        assert all(isinstance(number, float) for row in numbers for number in row)
        since = types["builtin_interfaces/msg/Duration"](**entry["time_from_start"])
        point = types["trajectory_msgs/msg/JointTrajectoryPoint"]
        points.append(point(*(np.array(row, dtype=float) for row in numbers), since))
    stamp = types["builtin_interfaces/msg/Time"](**document["header"].pop("stamp"))
    header = types["std_msgs/msg/Header"](stamp, **document["header"])
    return types[KIND](header, points=points, joint_names=document["joint_names"])


def test_yaml_becomes_the_message() -> None:
    trajectory = wave()
    text = io.StringIO()
    write_joint_trajectory(trajectory, text, rate=10.0)
    built = message(YAML(typ="safe", pure=True).load(text.getvalue()))
    read = STORE.deserialize_cdr(STORE.serialize_cdr(built, KIND), KIND)
    assert read.joint_names == ["shoulder", "elbow"]
    stamps = [p.time_from_start.sec + 1e-9 * p.time_from_start.nanosec for p in read.points]
    np.testing.assert_allclose(stamps[:-1], np.arange(20) * 0.1, atol=1e-9)
    assert stamps[-1] == pytest.approx(trajectory.duration)
    positions = np.array([point.positions for point in read.points])
    np.testing.assert_allclose(positions[:-1], trajectory.position[:200:10], atol=1e-7)
    np.testing.assert_allclose(positions[-1], trajectory.position[-1], atol=1e-7)
    velocities = np.array([point.velocities for point in read.points])
    np.testing.assert_allclose(velocities[:-1], trajectory.velocity[:200:10], atol=1e-7)


@pytest.mark.parametrize("rate", [0.0, 101.0, float("nan")])
def test_impossible_rate_of_points_is_refused(rate: float) -> None:
    with pytest.raises(UsageError, match="points per second"):
        write_joint_trajectory(wave(), io.StringIO(), rate=rate)


def test_columns_follow_the_order_of_the_robots_joints() -> None:
    written = wave()
    turned = written.in_order(("elbow", "shoulder"))
    assert turned.joints == ("elbow", "shoulder")
    for name in ("position", "velocity", "acceleration"):
        np.testing.assert_array_equal(getattr(turned, name), getattr(written, name)[:, ::-1])
