"""The node `predictor`: what the last identification predicts of a robot that runs."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields
from importlib import import_module
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from idim_iv_interfaces import msg
from idim_iv_ros.errors import UsageError
from idim_iv_ros.nodes.entry import LATCHED, run_node, steady_timer
from idim_iv_ros.nodes.joint_topic import JointTopic
from idim_iv_ros.nodes.parameters import (
    Settings,
    check_configuration,
    declare,
    follow_changes,
    parameter,
    period_of_status,
    read_configuration,
)
from idim_iv_ros.nodes.predictor.messages import (
    joint_diagnosis,
    prediction_diagnosis,
    prediction_message,
    residual_markers,
)
from idim_iv_ros.nodes.predictor.model_source import ModelSource
from idim_iv_ros.prediction import LivePrediction, Prediction
from idim_iv_ros.prediction.rows import joint_levels
from idim_iv_ros.signal_source import field_of, topic_of

_LOOK = 0.5  # s between two looks for publishers and for a new result
_MARKERS = 0.2  # s between two messages for RViz
_DESCRIPTIONS = ("robot_description", "/robot_description")

ABOUT = """predictor: what the last identification predicts of the efforts of a running robot.

  ros2 run idim_iv_ros predictor --ros-args -p configuration:=ROBOT.yaml -p result:=result.json
  ros2 topic echo /predictor/prediction

Without the parameter result it takes the newest result of the identifier, whose output directory
is the parameter output_directory. Topics: ~/prediction, ~/residual_markers, /diagnostics.
Parameters: ros2 param describe /predictor NAME."""


@dataclass(frozen=True)
class PredictorSettings(Settings):
    """Values of the parameters; the names are the same."""

    configuration: str = parameter("", "the robot's YAML file", read_only=True)
    result: str = parameter(
        "",
        "a result.json, which is read again when it changes; empty: the newest of the identifier",
    )
    output_directory: str = parameter(
        "results", "where the identifier of this robot writes its results", read_only=True
    )
    rate: float = parameter(20.0, "predictions per second, Hz", (1.0, 100.0), read_only=True)
    frame_prefix: str = parameter(
        "", "in front of the names of links in ~/residual_markers, as of robot_state_publisher"
    )
    false_warnings: float = parameter(
        1.0,
        "warnings a day of motion that are accepted while the model fits, all joints together",
        (1e-6, 1000.0),
    )
    status_period: float = period_of_status()

    def check(self) -> None:
        """Check what the ranges cannot express."""
        if not self.configuration:
            raise UsageError("configuration: name it: --ros-args -p configuration:=ROBOT.yaml")
        check_configuration(self.configuration)


class Predictor:
    """Parameters and topics around a `LivePrediction`.

    Raises
    ------
    UsageError
        A parameter has a value that is not allowed, or the URDF of the configuration is wrong.
    """

    def __init__(self, arguments: Sequence[str] = ()) -> None:
        self.node = node = Node("predictor")
        self._settings = declare(node, PredictorSettings, arguments)
        self._configuration = read_configuration(node, self._settings.configuration)
        import_module("scipy.signal")  # the first samples would wait a second for it
        self._joints = self._configuration.robot.joints
        self._source = ModelSource(self._configuration, Path(self._settings.output_directory))
        self._topics = self._joint_topics()
        self._live: LivePrediction | None = None
        self._newest = self._nothing("nothing has arrived")
        self._said = ""
        self._cpu = time.process_time(), time.monotonic()
        self._predictions = node.create_publisher(msg.Prediction, "~/prediction", 10)
        self._markers = node.create_publisher(MarkerArray, "~/residual_markers", 1)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_subscription(
            msg.IdentificationResult, "identifier/result", self._announced, LATCHED
        )
        if self._source.needs_description:
            for name in dict.fromkeys(map(node.resolve_topic_name, _DESCRIPTIONS)):
                node.create_subscription(String, name, self._described, LATCHED)
        steady_timer(node, 1.0 / self._settings.rate, self._predict)
        steady_timer(node, _LOOK, self._look)
        steady_timer(node, _MARKERS, self._mark)
        steady_timer(node, self._settings.status_period, self._report)
        follow_changes(node, lambda: self._settings, self._apply)
        names = ", ".join(topic.name for topic in self._topics)
        node.get_logger().info(f"ready: {self._settings.configuration} from {names}")
        self._look()

    def close(self) -> None:
        """Unsubscribe."""
        for topic in self._topics:
            topic.close()
        self.node.destroy_node()

    def _joint_topics(self) -> tuple[JointTopic, ...]:
        """The topic of positions and efforts, or one of each."""
        signals, resolve = self._configuration.signals, self.node.resolve_topic_name
        sources = {
            "position": signals.joint_states,
            "effort": signals.effort_topic or signals.joint_states,
        }
        fields: dict[str, dict[str, str | None]] = {}
        for quantity, source in sources.items():
            fields.setdefault(resolve(topic_of(source)), {})[quantity] = field_of(source)
        return tuple(JointTopic(self.node, name, self._joints, own) for name, own in fields.items())

    def _announced(self, message: msg.IdentificationResult) -> None:
        stamp = message.parameters.header.stamp
        if message.files:
            self._source.announce(message.files[0], stamp.sec * 10**9 + stamp.nanosec)
            self._look()

    def _described(self, message: String) -> None:
        self._source.describe(message.data, "robot_description")
        self._look()

    def _look(self) -> None:
        """Look for publishers, and for a new result."""
        for topic in self._topics:
            topic.look()
        if self._source.look(self._settings.result):
            identified = self._source.identified
            self._live = None
            if identified is not None:
                self._live = LivePrediction(identified, one_topic=len(self._topics) == 1)
                self.node.get_logger().info(f"predicting with {identified.path}")
        if self._source.reason != self._said:
            self._said = self._source.reason
            if self._said:
                self.node.get_logger().warning(self._said)

    def _predict(self) -> None:
        taken = {name: value for topic in self._topics for name, value in topic.take().items()}
        now = int(self.node.get_clock().now().nanoseconds)
        if self._live is None:
            self._newest = self._nothing(self._source.reason)
        else:
            self._live.add(taken["position"], taken["effort"], now)
            self._newest = self._live.newest(now)
            problem = next((topic.problem for topic in self._topics if topic.problem), "")
            if self._newest.reason and problem:
                self._newest = self._nothing(problem)
        now = int(self.node.get_clock().now().nanoseconds)
        identified = self._source.identified
        robot = self._configuration.robot.name or ""
        times = self._source.stamp, now
        self._predictions.publish(
            prediction_message(self._newest, identified, robot, self._joints, times)
        )

    def _nothing(self, reason: str) -> Prediction:
        absent = np.full(len(self._joints), np.nan)
        return Prediction(0, reason, absent, absent, absent, absent)

    def _mark(self) -> None:
        links = [self._settings.frame_prefix + link for link in self._source.links]
        if links and self._markers.get_subscription_count():
            shares = self._newest.noise_share.tolist()
            self._markers.publish(residual_markers(links, self._joints, shares))

    def _report(self) -> None:
        name = self.node.get_fully_qualified_name()
        live, identified = self._live, self._source.identified
        cpu, began = self._cpu
        self._cpu = time.process_time(), time.monotonic()
        values: dict[str, object] = {
            "result": "none" if identified is None else identified.path,
            "rate of the samples (Hz)": "unknown"
            if live is None or live.rate is None
            else f"{live.rate:.4g}",
            "filters wait for (s)": "unknown"
            if live is None or live.lag is None
            else f"{live.lag:.3f}",
            "samples out of order": 0 if live is None else live.late,
            "damaged messages": sum(topic.damaged for topic in self._topics),
            "processor (share of one core)": f"{(self._cpu[0] - cpu) / (self._cpu[1] - began):.3f}",
        }
        message = DiagnosticArray()
        message.header.stamp = self.node.get_clock().now().to_msg()
        message.status = [prediction_diagnosis(name, self._newest.reason, values)]
        if live is not None and live.rate is not None and identified is not None:
            accepted = self._settings.false_warnings
            levels = joint_levels(identified, live.rows, live.rate, accepted)
            message.status += [joint_diagnosis(name, level) for level in levels]
        self._diagnostics.publish(message)

    def _apply(self, settings: PredictorSettings, given: set[str]) -> None:
        self._settings = settings
        if given & {field.name for field in fields(settings)}:
            self._look()


def run(arguments: Sequence[str]) -> int:
    """Run the node until a signal and return the exit status; `arguments` begin with a name."""
    return run_node("predictor", Predictor, ABOUT, arguments)
