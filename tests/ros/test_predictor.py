"""A running robot's efforts beside what its identification predicts, as users hear them."""

import math
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from idim_iv_interfaces.msg import IdentificationResult, Prediction
from idim_iv_ros.nodes.predictor.markers import colour_of, residual_markers
from tests.prediction.arm6 import YAML, configured, recorded, write_result
from tests.ros.processes import Observer, Process, start_node

JOINTS = configured().robot.joints
EVERY = 4  # of the 1 kHz of the recording: few enough for a busy machine
BATCH = 0.02  # s of messages that are published together
OK, WARN = 0, 1


class PlayedRobot:
    """Publishes the recording of the demo in real time, over and over, while the observer spins."""

    def __init__(self, observer: Observer, topic: str) -> None:
        self.observer = observer
        recording = recorded()
        self.position, self.effort = recording.position.values, recording.effort.values
        # Another order than that of the configuration, and a joint that it does not name.
        self.order = [5, 0, 3, 1, 4, 2]
        self.names = ["gripper", *(JOINTS[k] for k in self.order)]
        self.publisher = observer.node.create_publisher(JointState, topic, 1000)
        self.begin, self.sent, self.without = time.time(), 0, ""

    def restart(self) -> None:
        """Begin with the first row; the last one is elsewhere, so that the joints jump."""
        self.begin, self.sent = time.time(), 0

    def publish(self) -> None:
        """Publish everything that is due."""
        due = int((time.time() - self.begin) * 1000.0 / EVERY)
        for number in range(self.sent, due):
            row = number * EVERY % len(self.position)
            stamp = round((self.begin + number * EVERY / 1000.0) * 1e9)
            message = JointState(name=self.names)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            message.position = [0.0, *self.position[row, self.order].tolist()]
            effort = [0.0, *self.effort[row, self.order].tolist()]
            if self.without:
                effort[self.names.index(self.without)] = math.nan
            message.effort = effort
            self.publisher.publish(message)
        self.sent = due

    def until(self, holds, what: str, timeout: float = 15.0) -> None:
        def published_and_holds() -> bool:
            self.publish()
            return bool(holds())

        self.observer.until(published_and_holds, what, timeout)


class Heard:
    """What a predictor says."""

    def __init__(self, observer: Observer, process: Process) -> None:
        self.name = process.name
        self.predictions: list[Prediction] = []
        self.diagnostics: dict[str, tuple[int, str]] = {}
        self.markers: list[MarkerArray] = []
        node = observer.node
        self._subscriptions = [
            node.create_subscription(
                Prediction, f"/{self.name}/prediction", self.predictions.append, 100
            ),
            node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnosis, 10),
            node.create_subscription(
                MarkerArray, f"/{self.name}/residual_markers", self.markers.append, 10
            ),
        ]
        self._node = node

    def _diagnosis(self, message: DiagnosticArray) -> None:
        for each in message.status:
            source, _, what = each.name.partition(": ")
            if source == f"/{self.name}":
                self.diagnostics[what] = (each.level[0], each.message)

    @property
    def last(self) -> Prediction:
        return self.predictions[-1] if self.predictions else Prediction(reason="nothing heard")

    def close(self) -> None:
        for each in self._subscriptions:
            self._node.destroy_subscription(each)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output directory of an identifier, with one result that is not announced yet."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "first").mkdir()
    write_result(folder / "first" / "result.json")
    return folder


@pytest.fixture(scope="module")
def robot(observer: Observer) -> PlayedRobot:
    return PlayedRobot(observer, "/played_joint_states")


@pytest.fixture(scope="module")
def predictor(
    results: Path, tmp_path_factory: pytest.TempPathFactory, observer: Observer
) -> Iterator[Heard]:
    folder = tmp_path_factory.mktemp("predictor")
    with ExitStack() as stack:
        process = start_node(
            "predictor",
            folder,
            "joint_states:=/played_joint_states",
            "identifier/result:=/announced_result",
            configuration=YAML,
            output_directory=results,
            status_period=0.2,
        )
        stack.callback(process.end)
        heard = Heard(observer, process)
        stack.callback(heard.close)
        yield heard


def announce(observer: Observer, file: str, stamp: int):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = observer.node.create_publisher(IdentificationResult, "/announced_result", latched)
    message = IdentificationResult(files=[file])
    message.parameters.header.stamp.sec = stamp
    publisher.publish(message)
    return publisher


def test_a_result_is_predicted_with_as_soon_as_it_is_announced(
    observer: Observer, robot: PlayedRobot, predictor: Heard, results: Path
) -> None:
    robot.until(lambda: predictor.predictions, "a message")
    assert not predictor.last.valid
    assert predictor.last.reason.startswith("no result yet")
    publisher = announce(observer, "first/result.json", 1_700_000_000)
    robot.until(lambda: predictor.last.valid, "a prediction")
    robot.restart()
    begin = time.monotonic()
    robot.until(lambda: time.monotonic() - begin > 1.0, "the jump to have passed all filters")
    predictor.predictions.clear()
    begin = time.monotonic()
    robot.until(lambda: time.monotonic() - begin > 2.5, "some predictions")
    valid = [each for each in predictor.predictions if each.valid]
    assert 20 <= len(valid) <= 60  # at 20 Hz; a busy machine skips some
    assert list(valid[0].name) == JOINTS
    assert (valid[0].robot, valid[0].identified.sec) == ("arm6", 1_700_000_000)
    assert np.median([each.delay for each in valid]) < 0.25  # 0.15 s and the batches of the test
    residual = np.array([each.residual for each in valid])
    measured = np.array([each.measured for each in valid])
    # Names in another order: a single joint that was taken for another would not fit.
    assert np.all(np.nanstd(residual, axis=0) < 0.1 * np.nanstd(measured, axis=0))
    assert np.allclose(
        residual, measured - np.array([each.predicted for each in valid]), equal_nan=True
    )
    robot.until(lambda: np.isfinite(predictor.last.noise_share).any(), "shares")
    robot.until(lambda: JOINTS[5] in predictor.diagnostics, "diagnostics of the joints")
    level, sentence = predictor.diagnostics[JOINTS[0]]
    assert level == OK
    assert "N m RMS" in sentence or "no motion" in sentence
    robot.until(lambda: predictor.markers, "markers")
    markers = predictor.markers[-1].markers
    assert [each.header.frame_id for each in markers[::2]] == [f"link_{k}" for k in range(1, 7)]
    observer.node.destroy_publisher(publisher)


def test_an_effort_that_is_nan_silences_its_joint(robot: PlayedRobot, predictor: Heard) -> None:
    robot.until(lambda: predictor.last.valid, "a prediction")
    robot.without = JOINTS[2]
    robot.until(lambda: math.isnan(predictor.last.measured[2]), "a joint without effort")
    assert predictor.last.valid
    assert np.isfinite(np.delete(predictor.last.measured, 2)).all()
    robot.without = ""
    robot.until(lambda: math.isfinite(predictor.last.measured[2]), "its effort again")


def test_a_result_of_another_robot_is_refused_and_the_next_one_taken_up(
    observer: Observer, robot: PlayedRobot, predictor: Heard, results: Path
) -> None:
    text = (results / "first" / "result.json").read_text()
    for name in ("other", "second"):
        (results / name).mkdir()
    other = text.replace('"joint_1"', '"shoulder"')
    (results / "other" / "result.json").write_text(other)
    (results / "second" / "result.json").write_text(text)
    publisher = announce(observer, "other/result.json", 1_700_000_100)
    robot.until(lambda: "another robot" in predictor.last.reason, "the refusal")
    assert not predictor.last.valid
    assert "\n" not in predictor.last.reason
    robot.until(
        lambda: "another robot" in predictor.diagnostics.get("prediction", (0, ""))[1], "a warning"
    )
    assert predictor.diagnostics["prediction"][0] == WARN
    observer.node.destroy_publisher(publisher)
    publisher = announce(observer, "second/result.json", 1_700_000_200)
    robot.until(lambda: predictor.last.valid, "the next result")
    assert predictor.last.identified.sec == 1_700_000_200
    observer.node.destroy_publisher(publisher)


def test_a_robot_that_falls_silent_is_said_to_be(
    observer: Observer, robot: PlayedRobot, predictor: Heard
) -> None:
    robot.until(lambda: predictor.last.valid, "a prediction")
    observer.until(lambda: "no position for" in predictor.last.reason, "silence")
    assert np.isnan(predictor.last.predicted).all()
    robot.restart()
    robot.until(lambda: predictor.last.valid, "the robot again")


def test_colours_say_how_large_the_residual_is() -> None:
    green, amber, red = colour_of(1.0), colour_of(2.0), colour_of(4.0)
    assert green[1] > green[0] and red[0] > 4 * red[1]
    assert amber[0] > amber[2] and amber[1] > amber[2]
    assert colour_of(0.2) == green and colour_of(50.0) == red
    grey = colour_of(math.nan)
    assert max(grey) - min(grey) < 0.1
    markers = residual_markers(["link"], ["joint"], [math.nan]).markers
    assert [each.text for each in markers] == ["", "joint –"]
