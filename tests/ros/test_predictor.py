"""A running robot's efforts beside what its identification predicts, as users hear them."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from idim_iv_interfaces.msg import IdentificationResult, Prediction
from idim_iv_ros.nodes.predictor.node import Predictor, colour_of, residual_markers
from tests.prediction.arm6 import YAML, configured, recorded, write_result
from tests.ros.conftest import another_context
from tests.ros.processes import LATCHED, Observer

JOINTS = configured().robot.joints
START = 1_700_000_000 * 10**9  # ns
EVERY = 4  # of the 1 kHz of the recording: few enough for a busy machine
BATCH = 12  # messages that are published together, once the predictor has spoken
OK, WARN = 0, 1


class PlayedRobot:
    """Publishes the recording of the demo and its time, over and over, while the observer spins.

    It goes on whenever the predictor has said something: its time is the only one, and neither of
    the two can be late for the other.
    """

    def __init__(self, observer: Observer, topic: str) -> None:
        self.observer = observer
        self.clock = observer.node.create_publisher(Clock, "/clock", 1)
        self.time, self.answered = START, 0
        recording = recorded()
        self.position, self.effort = recording.position.values, recording.effort.values
        # Another order than that of the configuration, and a joint that it does not name.
        self.order = [5, 0, 3, 1, 4, 2]
        self.names = ["gripper", *(JOINTS[k] for k in self.order)]
        self.publisher = observer.node.create_publisher(JointState, topic, 1000)
        self.row = 0

    def restart(self) -> None:
        """Begin with the first row; the last one is elsewhere, so that the joints jump."""
        self.row = 0

    def publish(self, said: int) -> None:
        """Publish the next messages where the predictor has said anything new; `said` so often."""
        if said == self.answered:
            return
        self.answered = said
        for _ in range(BATCH):
            self.time += EVERY * 1_000_000
            sec, nanosec = divmod(self.time, 10**9)
            self.clock.publish(Clock(clock=Time(sec=sec, nanosec=nanosec)))
            row, self.row = self.row, (self.row + EVERY) % len(self.position)
            message = JointState(name=self.names)
            message.header.stamp = Time(sec=sec, nanosec=nanosec)
            message.position = [0.0, *self.position[row, self.order].tolist()]
            message.effort = [0.0, *self.effort[row, self.order].tolist()]
            self.publisher.publish(message)


class Heard:
    """What a predictor says."""

    name = "predictor"

    def __init__(self, observer: Observer) -> None:
        self.observer = observer
        self.predictions: list[Prediction] = []
        self.said = 0
        self.markers: list[MarkerArray] = []
        node = observer.node
        subscribe, markers = node.create_subscription, f"/{self.name}/residual_markers"
        subscribe(Prediction, f"/{self.name}/prediction", self._prediction, 100)
        subscribe(MarkerArray, markers, self.markers.append, 10)

    def _prediction(self, message: Prediction) -> None:
        self.said += 1
        self.predictions.append(message)

    def diagnosis(self, what: str) -> tuple[int, str]:
        """Level and sentence of a status."""
        return self.observer.diagnosis(self.name, what)

    @property
    def last(self) -> Prediction:
        return self.predictions[-1] if self.predictions else Prediction(reason="nothing heard")

    def until(self, robot: PlayedRobot, condition, what: str) -> None:
        """Let the robot move until something holds."""

        def published_and_true() -> bool:
            robot.publish(self.said)
            return bool(condition())

        robot.observer.until(published_and_true, what)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The output directory of an identifier, with one result that is not announced yet."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "first").mkdir()
    write_result(folder / "first" / "result.json")
    return folder


@pytest.fixture(scope="module")
def predictor(results: Path) -> Iterator[Heard]:
    """A predictor in this process, spun by who hears it."""
    with another_context() as begin:
        begin(
            *("-r", "joint_states:=/played_joint_states"),
            configuration=YAML,
            output_directory=results,
            status_period=0.2,
            rate=100.0,
            use_sim_time="true",
        )
        observer, program = Observer(), Predictor()
        observer.executor.add_node(program.node)
        yield Heard(observer)
        program.close()
        observer.node.destroy_node()


@pytest.fixture(scope="module")
def observer(predictor: Heard) -> Observer:
    return predictor.observer


@pytest.fixture(scope="module")
def robot(observer: Observer) -> PlayedRobot:
    return PlayedRobot(observer, "/played_joint_states")


def announce(observer: Observer, file: str, stamp: int):
    publisher = observer.node.create_publisher(IdentificationResult, "/identifier/result", LATCHED)
    message = IdentificationResult(files=[file])
    message.parameters.header.stamp.sec = stamp
    publisher.publish(message)
    return publisher


def test_a_result_is_predicted_with_as_soon_as_it_is_announced(
    observer: Observer, robot: PlayedRobot, predictor: Heard, results: Path
) -> None:
    predictor.until(robot, lambda: predictor.predictions, "a message")
    assert not predictor.last.valid
    assert predictor.last.reason.startswith("no result yet")
    publisher = announce(observer, "first/result.json", 1_700_000_000)
    predictor.until(robot, lambda: predictor.last.valid, "a prediction")
    robot.restart()
    begin = robot.time
    predictor.until(
        robot, lambda: robot.time > begin + 1_000_000_000, "the jump to have passed all filters"
    )
    predictor.predictions.clear()
    predictor.until(robot, lambda: len(predictor.predictions) >= 50, "some predictions")
    valid = [prediction for prediction in predictor.predictions if prediction.valid]
    assert len(valid) == len(predictor.predictions)
    assert list(valid[0].name) == JOINTS
    assert (valid[0].robot, valid[0].identified.sec) == ("arm6", 1_700_000_000)
    assert max(item.delay for item in valid) < 0.3  # 0.15 s and two batches of the test
    residual = np.array([item.residual for item in valid])
    measured = np.array([item.measured for item in valid])
    # Names in another order: a single joint that was taken for another would not fit.
    assert np.all(np.nanstd(residual, axis=0) < 0.1 * np.nanstd(measured, axis=0))
    assert np.allclose(
        residual, measured - np.array([item.predicted for item in valid]), equal_nan=True
    )
    predictor.until(robot, lambda: np.isfinite(predictor.last.noise_share).any(), "shares")
    predictor.until(robot, lambda: predictor.diagnosis(JOINTS[5])[1], "diagnostics of the joints")
    level, sentence = predictor.diagnosis(JOINTS[0])
    assert level == OK
    assert "N m RMS" in sentence or "no motion" in sentence
    predictor.until(robot, lambda: predictor.markers, "markers")
    markers = predictor.markers[-1].markers
    assert [marker.header.frame_id for marker in markers[::2]] == [f"link_{k}" for k in range(1, 7)]
    observer.node.destroy_publisher(publisher)


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
    predictor.until(robot, lambda: "another robot" in predictor.last.reason, "the refusal")
    assert not predictor.last.valid
    assert "\n" not in predictor.last.reason
    predictor.until(
        robot, lambda: "another robot" in predictor.diagnosis("prediction")[1], "a warning"
    )
    assert predictor.diagnosis("prediction")[0] == WARN
    observer.node.destroy_publisher(publisher)
    publisher = announce(observer, "second/result.json", 1_700_000_200)
    predictor.until(robot, lambda: predictor.last.valid, "the next result")
    assert predictor.last.identified.sec == 1_700_000_200
    observer.node.destroy_publisher(publisher)


def test_colours_say_how_large_the_residual_is() -> None:
    green, amber, red = colour_of(1.0), colour_of(2.0), colour_of(4.0)
    assert green[1] > green[0] and red[0] > 4 * red[1]
    assert amber[0] > amber[2] and amber[1] > amber[2]
    assert colour_of(0.2) == green and colour_of(50.0) == red
    grey = colour_of(math.nan)
    assert max(grey) - min(grey) < 0.1
    markers = residual_markers(["link"], ["joint"], [math.nan]).markers
    assert [marker.text for marker in markers] == ["", "joint –"]
