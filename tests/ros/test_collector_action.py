"""The action of ros2_control, with definitions of our own: control_msgs is not on PyPI.

The fields and numbers are those of control_msgs (control_msgs/action/FollowJointTrajectory.action,
control_msgs/msg/JointTolerance.msg), without what belongs to floating joints.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from tests.ros.conftest import ARM2
from tests.ros.processes import ROOT, Observer, Process, start_node
from tests.ros.test_collector import Collector

pytestmark = pytest.mark.load

TOLERANCE = "string name\nfloat64 position\nfloat64 velocity\nfloat64 acceleration\n"
ACTION = """trajectory_msgs/JointTrajectory trajectory
JointTolerance[] path_tolerance
JointTolerance[] goal_tolerance
builtin_interfaces/Duration goal_time_tolerance
---
int32 SUCCESSFUL = 0
int32 INVALID_GOAL = -1
int32 INVALID_JOINTS = -2
int32 OLD_HEADER_TIMESTAMP = -3
int32 PATH_TOLERANCE_VIOLATED = -4
int32 GOAL_TOLERANCE_VIOLATED = -5
int32 error_code
string error_string
---
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
"""
GENERATED = """rosidl_generate_interfaces(${PROJECT_NAME}
  "msg/JointTolerance.msg"
  "action/FollowJointTrajectory.action"
  DEPENDENCIES action_msgs builtin_interfaces std_msgs trajectory_msgs
)

"""


def write_package(folder: Path) -> None:
    """A package `control_msgs` that is built as idim_iv_interfaces is."""
    ours = ROOT / "idim_iv_interfaces"
    for part, name, text in (
        ("msg", "JointTolerance.msg", TOLERANCE),
        ("action", "FollowJointTrajectory.action", ACTION),
    ):
        (folder / part).mkdir(parents=True)
        (folder / part / name).write_text(text)
    project = (ours / "pyproject.toml").read_text()
    project = project.replace('name = "idim-iv-interfaces"', 'name = "control-msgs-of-a-test"')
    wheels = '"ros-jazzy-std-msgs",\n]'
    assert wheels in project
    project = project.replace(wheels, '"ros-jazzy-std-msgs",\n"ros-jazzy-common-interfaces",\n]')
    (folder / "pyproject.toml").write_text(project)
    package = (ours / "package.xml").read_text().replace("idim_iv_interfaces", "control_msgs")
    depend = "<depend>std_msgs</depend>"
    package = package.replace(depend, f"{depend}<depend>trajectory_msgs</depend>")
    (folder / "package.xml").write_text(package)
    build = (ours / "CMakeLists.txt").read_text()
    begin, end = build.index("rosidl_generate_interfaces("), build.index("# The targets of")
    build = build[:begin] + GENERATED + build[end:]
    build = build.replace("project(idim_iv_interfaces)", "project(control_msgs)")
    find = "find_package(std_msgs REQUIRED)"
    build = build.replace(find, f"{find}\nfind_package(trajectory_msgs REQUIRED)")
    (folder / "CMakeLists.txt").write_text(build)


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the definitions are installed: a minute or two of compiling."""
    folder = tmp_path_factory.mktemp("control_msgs")
    write_package(folder / "source")
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps"]
    prefix = folder / "prefix"
    subprocess.run(
        [*pip, "--prefix", str(prefix), str(folder / "source")], check=True, capture_output=True
    )
    return prefix


@pytest.fixture(scope="module")
def collector(
    prefix: Path, observer: Observer, simulated_bags: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Collector]:
    """A collector and a controller that have control_msgs."""
    (site,) = prefix.glob("lib/python*/site-packages")
    folder = tmp_path_factory.mktemp("nodes")
    first = {
        "AMENT_PREFIX_PATH": str(prefix),
        "LD_LIBRARY_PATH": str(prefix / "lib"),
        "PYTHONPATH": f"{site}{os.pathsep}{ROOT}",
    }
    with ExitStack() as stack, pytest.MonkeyPatch.context() as patch:
        for name, path in first.items():
            patch.setenv(name, path, prepend=os.pathsep)
        script = [sys.executable, str(ROOT / "tests" / "ros" / "trajectory_server.py")]
        server = Process([*script, str(simulated_bags / "bag-1.mcap")], folder, "controller")
        stack.callback(server.kill)
        given = {"motion": "random", "slow_speed": 0.5, "approach_speed": 0.5, "stale_after": 10.0}
        process = start_node(
            "collector",
            folder,
            configuration=ARM2,
            controller="arm",
            interface="action",
            allow_motion=True,
            **given,
        )
        stack.callback(process.end)
        yield Collector(observer, process)


@pytest.fixture(autouse=True)
def followed(collector: Collector, observer: Observer) -> None:
    observer.set_on("controller", mode="follow")


def test_whole_goal_by_the_action(collector: Collector) -> None:
    answer = collector.collect()
    assert answer.success, answer.message
    assert answer.usable


def test_cancelled_goal_cancels_that_of_the_controller(
    collector: Collector, observer: Observer
) -> None:
    places: list[np.ndarray] = []
    heard = observer.node.create_subscription(
        JointState,
        "/joint_states",
        lambda message: places.append(np.array(message.position)),
        qos_profile_sensor_data,
    )
    goal = collector.send(duration=4.0)
    collector.until("slow pass", lambda: collector.feedback[-1].progress > 0.1)
    goal.cancel_goal_async()
    answer = collector.result(goal)
    assert answer.status == GoalStatus.STATUS_CANCELED
    assert answer.result.message == "stopped in slow pass: cancelled"
    places.clear()
    observer.until(lambda: len(places) > 50, "joint states")
    observer.node.destroy_subscription(heard)
    assert np.ptp(places[-30:], axis=0).max() == 0.0


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("refuse", "the controller refuses the trajectory"),
        ("abort", "the controller ends the motion: PATH_TOLERANCE_VIOLATED joint_2 is late"),
    ],
)
def test_what_the_controller_says_is_the_answer(
    collector: Collector, observer: Observer, mode: str, words: str
) -> None:
    observer.set_on("controller", mode=mode)
    answer = collector.collect(duration=2.0, seed=5)
    assert answer.message == f"stopped in moving to the start: {words}"
