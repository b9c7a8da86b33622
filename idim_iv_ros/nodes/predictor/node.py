"""The node `predictor`: predicts the efforts of a running robot by the last identification."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import ColorRGBA, String
from visualization_msgs.msg import Marker, MarkerArray

from idim_iv_interfaces import msg
from idim_iv_ros.configuration import Configuration
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
    IdentifiedModel,
    JointLevel,
    identified_model,
    joint_levels,
)
from idim_iv_ros.prediction.live import LivePrediction, Prediction
from idim_iv_ros.signal_source import field_of, topic_of

WAITING = "no result yet: identify the robot, or set the parameter result"
_ADVICE = "output_directory must be that of the identifier, on the same machine"


@dataclass(frozen=True)
class _Described:
    """A URDF with the model made of it; `links` are the child links of the joints, in order."""

    text: str
    source: str
    model: InverseModel
    links: tuple[str, ...]


class ModelSource:
    """Reads the result to predict with: a file of the user, or the identifier's newest.

    `output_directory` is that of the identifier. `identified` is the model, or None; `stamp` is
    when its identification ended, ns since 1970; `reason` says why there is no model, or is empty.
    """

    def __init__(self, configuration: Configuration, output_directory: Path) -> None:
        self._configuration, self._directory = configuration, output_directory
        self._described: _Described | None = None
        self._announced: tuple[Path, int] | None = None
        self._read: tuple[Path, int, str] | None = None
        self.identified: IdentifiedModel | None = None
        self.stamp = 0
        self.reason = WAITING
        path = configuration.robot.description
        if path is not None:
            self._describe(read_urdf_file(path), str(path))
        self._announce_kept()

    @property
    def links(self) -> tuple[str, ...]:
        """Return the child link of each joint; empty before there is a URDF."""
        return () if self._described is None else self._described.links

    def describe(self, text: str, source: str) -> None:
        """Use the URDF `text` from a topic."""
        if self._described is None or self._described.text != text:
            self._read = None
            try:
                self._describe(text, source)
            except IdimError as error:
                self.identified, self.reason = None, str(error)

    def announce(self, file: str, stamp: int) -> None:
        """Remember the identifier's newest result, a file relative to its output directory."""
        self._announced = self._directory / file, stamp

    def look(self, pinned: str) -> bool:
        """Read the result if it is new, and return whether `identified` changed.

        `pinned` is the file that the user chose; empty for the newest that was announced.
        """
        if self._described is None:
            self.reason = "no URDF: none in the configuration, and none on robot_description yet"
            return False
        wanted = (Path(pinned), 0) if pinned else self._announced
        if wanted is None:
            return self._drop_model(WAITING, None)
        path, stamp = wanted
        try:
            written = path.stat().st_mtime_ns
        except OSError as error:
            advice = "set the parameter result" if pinned else _ADVICE
            return self._drop_model(f"{path}: {error.strerror or error}: {advice}", None)
        content = (path, written, self._described.text)
        if content == self._read:
            return False
        try:
            self.identified = identified_model(
                path, self._configuration, self._described.model, self._described.source
            )
        except IdimError as error:
            return self._drop_model(str(error), content)
        self._read, self.reason, self.stamp = content, "", stamp or written
        return True

    def _drop_model(self, reason: str, content: tuple[Path, int, str] | None) -> bool:
        """Drop the model for a `reason`, and return whether there was one.

        `content`: what was read and is no model, so that it is not read again; None: nothing was.
        """
        self.reason, self._read = reason, content
        changed, self.identified = self.identified is not None, None
        return changed

    def _describe(self, text: str, source: str) -> None:
        """Build the model of a URDF text; `source` names it in messages."""
        model = build_inverse_model(self._configuration, text, source)
        joints = read_urdf_text(text, source).joints
        links = tuple(joints[name].child for name in self._configuration.robot.joints)
        self._described = _Described(text, source, model, links)

    def _announce_kept(self) -> None:
        """Announce the newest result of the node's configuration in the identifier's history."""
        try:
            entries = EstimateHistory(self._directory).entries
        except IdimError:
            return  # what the identifier cannot read either, it says itself
        of_node = [entry for entry in entries if not entry.configuration]
        newest = [entry for entry in of_node if entry.estimator == ESTIMATORS[0]] or of_node
        if newest:
            self.announce(f"{newest[-1].folder}/{RESULT}", newest[-1].stamp)


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
        self._source = ModelSource(self._configuration, Path(self._settings.output_directory))
        self._topics = self._joint_topics()
        self._live: LivePrediction | None = None
        self._newest = Prediction.absent(len(self._joints), "nothing has arrived")
        self._said = ""
        self._predictions = node.create_publisher(msg.Prediction, "~/prediction", 10)
        self._markers = node.create_publisher(MarkerArray, "~/residual_markers", 1)
        self._diagnostics = Diagnostics(node)
        node.create_subscription(
            msg.IdentificationResult, "identifier/result", self._announced, LATCHED
        )
        if self._configuration.robot.description is None:
            for name in dict.fromkeys(map(node.resolve_topic_name, _DESCRIPTIONS)):
                node.create_subscription(String, name, self._described, LATCHED)
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

    def _joint_topics(self) -> tuple[JointTopic, ...]:
        """Return the subscriptions to positions and efforts; one if they share a topic."""
        signals, resolve = self._configuration.signals, self.node.resolve_topic_name
        sources = {
            "position": signals.joint_states,
            "effort": signals.effort_topic or signals.joint_states,
        }
        fields: dict[str, dict[str, str | None]] = {}
        for quantity, source in sources.items():
            fields.setdefault(resolve(topic_of(source)), {})[quantity] = field_of(source)
        return tuple(
            JointTopic(self.node, name, self._joints, named) for name, named in fields.items()
        )

    def _announced(self, message: msg.IdentificationResult) -> None:
        stamp = message.parameters.header.stamp
        if message.files:
            self._source.announce(message.files[0], stamp.sec * 10**9 + stamp.nanosec)
            self._look()

    def _described(self, message: String) -> None:
        self._source.describe(message.data, "robot_description")
        self._look()

    def _look(self) -> None:
        """Look for new publishers and a new result."""
        for topic in self._topics:
            topic.look()
        if self._source.look(self._settings.result):
            identified = self._source.identified
            self._live = None
            if identified is not None:
                self._live = LivePrediction(identified)
                self.node.get_logger().info(f"predicting with {identified.path}")
        if self._source.reason != self._said:
            self._said = self._source.reason
            if self._said:
                self.node.get_logger().warning(self._said)

    def _predict(self) -> None:
        taken = {name: value for topic in self._topics for name, value in topic.take().items()}
        if self._live is None:
            self._newest = Prediction.absent(len(self._joints), self._source.reason)
        else:
            now = self._now()
            self._live.add(taken["position"], taken["effort"], now)
            self._newest = self._live.newest(now)
            problem = next((topic.problem for topic in self._topics if topic.problem), "")
            if self._newest.reason and problem:
                self._newest = Prediction.absent(len(self._joints), problem)
        newest, identified = self._newest, self._source.identified
        message = message_of(
            msg.Prediction,
            newest,
            header=newest.stamp,
            robot=self._configuration.robot.name if identified is None else identified.result.robot,
            valid=not newest.reason,
            identified=0 if identified is None else self._source.stamp,
            name=self._joints,
            noise_floor=[None] * len(self._joints)
            if identified is None
            else identified.noise_floor,
            delay=(self._now() - newest.stamp) * 1e-9 if newest.stamp else None,
        )
        self._predictions.publish(message)

    def _mark(self) -> None:
        links = [self._settings.frame_prefix + link for link in self._source.links]
        if links and self._markers.get_subscription_count():
            shares = self._newest.noise_share.tolist()
            self._markers.publish(residual_markers(links, self._joints, shares))

    def _report(self) -> None:
        name = self.node.get_fully_qualified_name()
        live, identified = self._live, self._source.identified
        window = None if live is None else live.window
        values: dict[str, object] = {
            "result": "none" if identified is None else identified.path,
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
        if live is not None and window is not None and identified is not None:
            accepted = self._settings.false_warnings
            levels = joint_levels(identified, live.rows, window.rate, accepted)
            statuses += [joint_diagnosis(name, level) for level in levels]
        self._diagnostics.publish(*statuses)

    def _apply(self, given: set[str]) -> None:
        self._look()


def joint_diagnosis(name: str, level: JointLevel) -> DiagnosticStatus:
    """Return a joint's status; WARN if its residual exceeds the limit of the noise floor."""
    values: dict[str, object] = {
        "unit": level.unit,
        f"residual, RMS ({level.unit})": f"{level.rms:.4g}",
        f"noise floor, RMS ({level.unit})": f"{level.noise_floor:.4g}",
        SHARE: f"{level.share:.3f}",
        LIMIT: "unknown" if level.limit is None else f"{level.limit:.3f}",
        "motion behind it (s)": f"{level.seconds:.1f}",
    }
    severity = DiagnosticStatus.WARN if level.beyond else DiagnosticStatus.OK
    return diagnostic_status(
        severity, f"{name}: {level.joint}", level.joint, level.sentence, values
    )


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
        red, green, blue = colour_of(share)
        sphere = _marker(link, "residual", number, Marker.SPHERE)
        sphere.scale.x = sphere.scale.y = sphere.scale.z = _DIAMETER
        sphere.color = ColorRGBA(r=red, g=green, b=blue, a=_ALPHA)
        text = _marker(link, "share", number, Marker.TEXT_VIEW_FACING)
        text.pose.position.z = _LIFT
        text.scale.z = _TEXT
        text.color = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
        text.text = f"{joint} {share:.1f}×" if math.isfinite(share) else f"{joint} –"
        markers += [sphere, text]
    return MarkerArray(markers=markers)


def _marker(frame: str, namespace: str, number: int, kind: int) -> Marker:
    marker = Marker(ns=namespace, id=number, type=kind, action=Marker.ADD, frame_locked=True)
    marker.header.frame_id = frame  # its stamp stays zero: where the link is now
    marker.pose.orientation.w = 1.0
    marker.lifetime.sec = 2
    return marker


run = partial(run_node, "predictor", Predictor, ABOUT)
