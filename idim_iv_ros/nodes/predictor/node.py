"""The node `predictor`: predicts the efforts of a running robot by the last identification."""

import math
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker, MarkerArray

from idim_iv_interfaces import msg
from idim_iv_ros.errors import IdimError
from idim_iv_ros.files import RESULT
from idim_iv_ros.model import InverseModel, build_inverse_model, read_urdf_file, read_urdf_text
from idim_iv_ros.nodes.entry import LATCHED, run_node, steady_timer
from idim_iv_ros.nodes.identifier.estimate_history import EstimateHistory
from idim_iv_ros.nodes.identifier.job_queue import ESTIMATORS
from idim_iv_ros.nodes.joint_topic import JointTopic
from idim_iv_ros.nodes.messages import Diagnostics, diagnostic_status, message_of
from idim_iv_ros.nodes.parameters import NodeProgram, read_configuration
from idim_iv_ros.nodes.settings import PredictorSettings
from idim_iv_ros.prediction.identified_model import (
    LIMIT,
    SHARE,
    JointLevel,
    identified_model,
    joint_levels,
)
from idim_iv_ros.prediction.live import LivePrediction, Prediction
from idim_iv_ros.signal_source import field_of, topic_of

_NO_URDF = "no URDF: none in the configuration, and none on robot_description yet"
_WAITING = "no result yet: identify the robot, or set the parameter result"
_ADVICE = "output_directory must be that of the identifier, on the same machine"
_LOOK = 0.5  # s between two looks for publishers and for a new result
_MARKERS = 0.2  # s between two messages for RViz
_DIAMETER, _TEXT, _LIFT = 0.14, 0.05, 0.12  # m
_GREY = (0.55, 0.55, 0.58)
# Colours at one, two and four times the noise floor of the identification.
_COLOURS = ((0.13, 0.60, 0.33), (0.95, 0.68, 0.10), (0.80, 0.12, 0.16))
_ALPHA = 0.75
_DESCRIPTIONS = ("robot_description", "/robot_description")

ABOUT = """predictor: what the last identification predicts of the efforts of a running robot.

  ros2 run idim_iv_ros predictor --ros-args -p configuration:=ROBOT.yaml -p result:=result.json
  ros2 topic echo /predictor/prediction

Without the parameter result it takes the newest result of the identifier, whose output directory
is the parameter output_directory. Topics: ~/prediction, ~/residual_markers, /diagnostics.
Parameters: ros2 param describe /predictor NAME."""


class Predictor(NodeProgram[PredictorSettings]):
    """The node `predictor`: topics around a `LivePrediction`."""

    def __init__(self, arguments: Sequence[str] = ()) -> None:
        super().__init__(Node("predictor"), PredictorSettings, arguments)
        node = self.node
        self._configuration = read_configuration(node, self._settings.configuration)
        import_module("scipy.signal")  # the first samples would wait a second for it
        self._joints = self._configuration.robot.joints
        self._links: list[str] = []  # child links of the joints
        self._robot: tuple[str, InverseModel, str] | None = None  # URDF, its model and its name
        self._no_robot = _NO_URDF  # or why it cannot be read
        self._announced: tuple[Path, int] | None = None  # newest result, and when it ended, ns
        self._read: tuple[Path, int, str] | None = None  # file, its time, and URDF
        self._live: LivePrediction | None = None
        self._identified_at = 0  # ns since 1970
        self._reason, self._said = _WAITING, ""  # why there is no model
        path = self._configuration.robot.description
        if path is not None:
            self._describe(read_urdf_file(path), str(path))
        self._announce_kept()
        signals, resolve = self._configuration.signals, node.resolve_topic_name
        efforts = signals.effort_topic or signals.joint_states
        fields: dict[str, dict[str, str | None]] = {}  # of one topic where both share it
        for quantity, source in (("position", signals.joint_states), ("effort", efforts)):
            fields.setdefault(resolve(topic_of(source)), {})[quantity] = field_of(source)
        self._topics = [
            JointTopic(node, name, self._joints, named) for name, named in fields.items()
        ]
        self._newest = Prediction.absent(len(self._joints), "nothing has arrived")
        self._predictions = node.create_publisher(msg.Prediction, "~/prediction", 10)
        self._markers = node.create_publisher(MarkerArray, "~/residual_markers", 1)
        self._diagnostics = Diagnostics(node)
        node.create_subscription(
            msg.IdentificationResult, "identifier/result", self._hear_result, LATCHED
        )
        if path is None:
            for name in dict.fromkeys(map(node.resolve_topic_name, _DESCRIPTIONS)):
                node.create_subscription(String, name, self._hear_description, LATCHED)
        steady_timer(node, 1.0 / self._settings.rate, self._predict)
        steady_timer(node, _LOOK, self._look)
        steady_timer(node, _MARKERS, self._mark)
        steady_timer(node, self._settings.status_period, self._report)
        self._follow_changes()
        names = ", ".join(topic.name for topic in self._topics)
        node.get_logger().info(f"ready: {self._settings.configuration} from {names}")
        self._look()

    def close(self) -> None:
        """Unsubscribe, and end the node."""
        for topic in self._topics:
            topic.close()
        super().close()

    def _describe(self, text: str, source: str) -> None:
        model = build_inverse_model(self._configuration, text, source)
        joints = read_urdf_text(text, source).joints
        self._links = [joints[name].child for name in self._joints]
        self._robot = text, model, source

    def _announce_kept(self) -> None:
        """Announce the newest result of the node's configuration in the identifier's history."""
        directory = Path(self._settings.output_directory)
        try:
            entries = EstimateHistory(directory).entries
        except IdimError:
            return  # what the identifier cannot read either, it says itself
        of_node = [entry for entry in entries if not entry.configuration]
        newest = [entry for entry in of_node if entry.estimator == ESTIMATORS[0]] or of_node
        if newest:
            self._announced = directory / newest[-1].folder / RESULT, newest[-1].stamp

    def _hear_result(self, message: msg.IdentificationResult) -> None:
        stamp = message.parameters.header.stamp
        if message.files:
            path = Path(self._settings.output_directory) / message.files[0]
            self._announced = path, stamp.sec * 10**9 + stamp.nanosec
            self._look()

    def _hear_description(self, message: String) -> None:
        if self._robot is None or self._robot[0] != message.data:
            self._robot = None  # a result may be of another one
            try:
                self._describe(message.data, "robot_description")
            except IdimError as error:
                self._no_robot = str(error)
        self._look()

    def _look(self) -> None:
        for topic in self._topics:
            topic.look()
        self._look_for_result()
        if self._reason != self._said:
            self._said = self._reason
            if self._said:
                self.node.get_logger().warning(self._said)

    def _look_for_result(self) -> None:
        """Read the result that the user chose, or else the newest announced one, if it is new."""
        pinned = self._settings.result
        wanted = (Path(pinned), 0) if pinned else self._announced
        live, content, reason = None, None, _WAITING if self._robot else self._no_robot
        if self._robot is not None and wanted is not None:
            (path, stamp), (text, model, source) = wanted, self._robot
            try:
                written = path.stat().st_mtime_ns
                content = (path, written, text)
                if content == self._read:
                    return
                identified = identified_model(path, self._configuration, model, source)
                live, reason, self._identified_at = LivePrediction(identified), "", stamp or written
                self.node.get_logger().info(f"predicting with {path}")
            except OSError as error:
                advice = "set the parameter result" if pinned else _ADVICE
                reason = f"{path}: {error.strerror or error}: {advice}"
            except IdimError as error:
                reason = str(error)
        self._live, self._read, self._reason = live, content, reason

    def _predict(self) -> None:
        taken = {name: value for topic in self._topics for name, value in topic.take().items()}
        joints, live = self._joints, self._live
        robot, noise_floor = self._configuration.robot.name, np.full(len(joints), np.nan)
        if live is None:
            self._newest = Prediction.absent(len(joints), self._reason)
        else:
            now = self._now()
            live.add(taken["position"], taken["effort"], now)
            self._newest = live.newest(now)
            problem = next((topic.problem for topic in self._topics if topic.problem), "")
            if self._newest.reason and problem:
                self._newest = Prediction.absent(len(joints), problem)
            robot, noise_floor = live.identified.result.robot, live.identified.noise_floor
        newest = self._newest
        message = message_of(
            msg.Prediction,
            newest,
            header=newest.stamp,
            robot=robot,
            valid=not newest.reason,
            identified=0 if live is None else self._identified_at,
            name=joints,
            noise_floor=noise_floor,
            delay=(self._now() - newest.stamp) * 1e-9 if newest.stamp else None,
        )
        self._predictions.publish(message)

    def _mark(self) -> None:
        links = [self._settings.frame_prefix + link for link in self._links]
        if links and self._markers.get_subscription_count():
            shares = self._newest.noise_share.tolist()
            self._markers.publish(residual_markers(links, self._joints, shares))

    def _report(self) -> None:
        name = self.node.get_fully_qualified_name()
        live = self._live
        window = None if live is None else live.window
        values: dict[str, object] = {
            "result": "none" if live is None else live.identified.path,
            "rate of the samples (Hz)": "unknown" if window is None else f"{window.rate:.4g}",
            "filters wait for (s)": "unknown" if window is None else f"{window.lag:.3f}",
            "samples out of order": 0 if live is None else live.late,
            "damaged messages": sum(topic.damaged for topic in self._topics),
        }
        reason = self._newest.reason
        level = DiagnosticStatus.WARN if reason else DiagnosticStatus.OK
        statuses = [
            diagnostic_status(level, f"{name}: prediction", name, reason or "predicting", values)
        ]
        levels: tuple[JointLevel, ...] = ()
        if live is not None and window is not None:
            accepted = self._settings.false_warnings
            levels = joint_levels(live.identified, live.rows, window.rate, accepted)
        for joint in levels:
            values = {
                "unit": joint.unit,
                f"residual, RMS ({joint.unit})": f"{joint.rms:.4g}",
                f"noise floor, RMS ({joint.unit})": f"{joint.noise_floor:.4g}",
                SHARE: f"{joint.share:.3f}",
                LIMIT: "unknown" if joint.limit is None else f"{joint.limit:.3f}",
                "motion behind it (s)": f"{joint.seconds:.1f}",
            }
            level = DiagnosticStatus.WARN if joint.beyond else DiagnosticStatus.OK
            title = f"{name}: {joint.joint}"
            statuses.append(diagnostic_status(level, title, joint.joint, joint.sentence, values))
        self._diagnostics.publish(*statuses)

    def _apply(self, given: set[str]) -> None:
        self._look()


def colour_of(share: float) -> tuple[float, float, float]:
    """Return red, green, blue (0 to 1) of residual / noise floor: green 1, amber 2, red from 4."""
    if not math.isfinite(share):
        return _GREY
    place = math.log2(max(share, 1e-9))
    red, green, blue = (
        np.interp(place, range(3), column) for column in zip(*_COLOURS, strict=True)
    )
    return float(red), float(green), float(blue)


def residual_markers(
    links: Sequence[str], joints: Sequence[str], shares: Sequence[float]
) -> MarkerArray:
    """Return a sphere and a text for each joint, in the frame of its link, for RViz.

    `shares` (n_joints,) are RMS of the residual over noise floor; NaN where unknown.
    """
    markers = []
    for number, (link, joint, share) in enumerate(zip(links, joints, shares, strict=True)):
        sphere = Marker(ns="residual", id=number, type=Marker.SPHERE)
        sphere.scale.x = sphere.scale.y = sphere.scale.z = _DIAMETER
        sphere.color = ColorRGBA(**dict(zip("rgb", colour_of(share), strict=True)), a=_ALPHA)
        text = Marker(ns="share", id=number, type=Marker.TEXT_VIEW_FACING)
        text.pose.position.z = _LIFT
        text.scale.z = _TEXT
        text.color = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
        text.text = f"{joint} {share:.1f}×" if math.isfinite(share) else f"{joint} –"
        for marker in (sphere, text):
            marker.action, marker.frame_locked = Marker.ADD, True
            marker.header.frame_id = link  # its stamp stays zero: where the link is now
            marker.pose.orientation.w = 1.0
            marker.lifetime.sec = 2
            markers.append(marker)
    return MarkerArray(markers=markers)


run = partial(run_node, "predictor", Predictor, ABOUT)
