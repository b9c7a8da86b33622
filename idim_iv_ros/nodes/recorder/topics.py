"""The topics of the recorder: the robot's signals and extra ones, also those that appear later.

Subscriptions use the QoS of the publishers, and are read without an executor.
"""

import os
import re
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from idim_iv_interfaces.msg import TopicStatus
from idim_iv_ros.configuration import SignalsSection
from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.messages import diagnostic_status
from idim_iv_ros.nodes.parameters import read_configuration
from idim_iv_ros.nodes.recorder.topic_monitor import JointContent, Taken, TopicMonitor
from idim_iv_ros.nodes.settings import RecorderSettings
from idim_iv_ros.recording.bags.joint_message_type import FLOAT_ARRAY, JOINT_STATE, ROS2_CONTROL
from idim_iv_ros.recording.request import ROBOT_DESCRIPTION, in_root
from idim_iv_ros.recording.writing.write import Definition, OfferedQos, TopicChannel
from idim_iv_ros.signal_source import field_of, topic_of
from idim_iv_ros.types import IntArray


@cache
def python_type(message_type: str) -> type:
    """Return the class of a message type; a DataError says which package to install."""
    package, kind, name = message_type.split("/")
    try:
        return getattr(import_module(f"{package}.{kind}"), name)  # type: ignore[no-any-return]
    except (ImportError, AttributeError) as error:
        distribution = os.environ.get("ROS_DISTRO", "jazzy")
        apt = f"ros-{distribution}-{package.replace('_', '-')}"
        raise DataError(
            f"it is {message_type}, whose package {package} is not installed here (apt install "
            f"{apt}): not recorded; a bag by `ros2 bag record` is read without it"
        ) from error


def why_unreadable(message_type: str) -> str:
    """Return why messages of a type cannot be recorded; empty if they can."""
    try:
        python_type(message_type)
        definition(message_type)
    except DataError as error:
        return str(error)
    return ""


def has_header(message_type: str) -> bool:
    """Return whether messages of a type begin with a std_msgs/Header."""
    fields: dict[str, str] = python_type(message_type).get_fields_and_field_types()  # type: ignore[attr-defined]
    return next(iter(fields.values()), "") == "std_msgs/Header"


@cache
def definition(message_type: str) -> Definition | None:
    """Return the definition of a type from .msg files; None for one that rosbags knows.

    Raises DataError: the files are missing or cannot be read.
    """
    store = get_typestore(Stores.ROS2_JAZZY)
    if message_type in store.fielddefs:
        return None
    types: dict[str, Any] = {}
    waiting = [message_type]
    while waiting:
        name = waiting.pop()
        if name in types or name in store.fielddefs:
            continue
        types.update(_types_from_file(name))
        waiting += [part for _, described in types[name][1] for part in _type_names(described)]
    store.register(types)
    text, _ = store.generate_msgdef(message_type, ros_version=2)
    return Definition(text, store.hash_rihs01(message_type))


def _types_from_file(message_type: str) -> dict[str, Any]:
    package, kind, name = message_type.split("/")
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    for prefix in filter(None, prefixes):
        path = Path(prefix) / "share" / package / kind / f"{name}.msg"
        try:
            return dict(get_types_from_msg(path.read_text(encoding="utf-8"), message_type))
        except FileNotFoundError:
            continue
        except Exception as error:  # a definition that rosbags cannot parse
            raise DataError(f"the definition of {message_type} in {path} cannot be read") from error
    raise DataError(
        f"it is {message_type}, whose definition is in none of the folders of AMENT_PREFIX_PATH: "
        "source the workspace that holds it; not recorded"
    )


def _type_names(described: tuple[Any, Any]) -> list[str]:
    node, detail = described
    if node == Nodetype.NAME:
        return [detail]
    return _type_names(detail[0]) if node in (Nodetype.ARRAY, Nodetype.SEQUENCE) else []


_STRING = "std_msgs/msg/String"
_AT_ONCE = 20_000  # messages that are taken in one go
_PERIOD = 1.0  # s between two looks for topics that match
_DESCRIPTIONS = 10  # descriptions of the robot that wait
_SILENT = 1.0  # s, at least
_SILENT_PERIODS = 20.0
RECENT = 10.0  # s for which an incident is a warning; totals stay among the values
_INCIDENTS = {
    "lost": "lost",
    "late": "late",
    "malformed": "malformed or too large",
    "backward": "stamped before the one before",
}
_COUNTED = ("received", "lost", "late", "gaps", "malformed", "backward")


def joint_types(quantities: Sequence[str], *, named_field: bool) -> list[str] | None:
    """Return message types with joint quantities; None (any type) where a field is named."""
    if named_field:
        return None
    numbers = [FLOAT_ARRAY] if list(quantities) == ["effort"] else []
    return [JOINT_STATE, *ROS2_CONTROL, *numbers]


class _NeverExecuted(CallbackGroup):
    """Callback group that keeps its subscriptions out of every executor."""

    def can_execute(self, entity: object) -> bool:
        return False

    beginning_execution = can_execute

    def ending_execution(self, entity: object) -> None:
        """Do nothing: no callback is ever executed."""


@dataclass(eq=False)
class WatchedTopic:
    """Subscription, channel and counts of one topic, whose `name` is fully qualified."""

    node: Node
    name: str
    types: Sequence[str] | None  # usable message types; None: any installed type
    depth: int  # messages that the middleware queues
    joints: Sequence[str] = ()  # these and the next as in `JointContent`
    needed: Sequence[str] = ()
    best_effort: bool = False  # and volatile, whatever the publishers offer
    problem: str = ""  # why the topic is not recorded
    note: str = ""  # what is unusual
    publishers: int = 0
    had_publishers: bool = False  # whether there ever was one
    too_large: int = 0  # messages left out for their size
    # Other topics that make up for this one if nobody publishes it.
    substitutes: "Sequence[WatchedTopic]" = ()
    channel: TopicChannel | None = None

    def __post_init__(self) -> None:
        self.monitor = TopicMonitor(None, has_header=False)
        self._group = _NeverExecuted()
        self._lock = threading.Lock()
        self._subscription: Subscription | None = None
        self._profile: QoSProfile | None = None
        self._type: object = None
        self._gids: frozenset[bytes] = frozenset()
        self._left: list[Taken] = []

    @property
    def absence(self) -> str:
        """Return why no message came, where that is unusual; else empty."""
        if self.problem:
            return f"{self.name}: {self.problem}"
        if self.types == [_STRING]:  # the description; a configuration may have it instead
            return ""
        if not self.had_publishers:
            return f"nobody publishes {self.name}"
        return f"nothing came on {self.name}" if self.types else ""

    def look(self) -> None:
        """Look for publishers; subscribe at the first, and anew when their QoS changes."""
        publishers = self.node.get_publishers_info_by_topic(self.name)
        self.publishers, self.problem = len(publishers), ""
        if not publishers:
            return
        offered = [publisher.topic_type for publisher in publishers]
        wanted = [kind for kind in offered if self.types is None or kind in self.types]
        if not wanted:
            plain = " or ".join(kind for kind in self.types or () if kind not in ROS2_CONTROL)
            state = ", or a state of control_msgs" if self.types != [_STRING] else ""
            self.problem = f"it is {offered[0]}; {plain} is needed{state}: not recorded"
        self.problem = self.problem or why_unreadable(wanted[0])
        if self.problem:
            return
        usable = [other for other in publishers if other.topic_type == wanted[0]]
        self.had_publishers = True
        gids = frozenset(bytes(publisher.endpoint_gid) for publisher in usable)
        if gids != self._gids:
            self._gids = gids
            self.monitor.new_publishers(len(gids))
            self._subscribe(usable)

    def take(self, largest: int) -> list[Taken]:
        """Return the messages that arrived; count and drop those of more than `largest` bytes."""
        with self._lock:
            fresh: list[Taken] = []
            if self._subscription is not None:
                self._drain(self._subscription, fresh)
            if self._left:
                seen = set(map(_message_key, self._left))
                fresh = [entry for entry in fresh if _message_key(entry) not in seen]
            taken, self._left = self._left + fresh, []
        if any(len(message) > largest for message, _ in taken):
            fitting = [entry for entry in taken if len(entry[0]) <= largest]
            self.too_large += len(taken) - len(fitting)
            return fitting
        return taken

    def close(self) -> None:
        """Unsubscribe."""
        with self._lock:
            if self._subscription is not None:
                self.node.destroy_subscription(self._subscription)
            self._subscription = None

    def _drain(self, subscription: Subscription, taken: list[Taken]) -> None:
        with suppress(InvalidHandle), subscription.handle:
            take, message_type = subscription.handle.take_message, self._type
            for _ in range(_AT_ONCE):
                message = take(message_type, True)
                if message is None:
                    return
                taken.append(message)

    def _subscribe(self, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Subscribe as reliable or transient local only if all publishers are, as rosbag2."""
        message_type = publishers[0].topic_type
        reliable, latched = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
        offered = tuple(
            OfferedQos(
                "reliable" if qos.reliability == reliable else "best_effort",
                "transient_local" if qos.durability == latched else "volatile",
                qos.depth or 10,
            )
            for qos in (publisher.qos_profile for publisher in publishers)
        )
        before = self.channel and self.channel.message_type
        self.channel = TopicChannel(self.name, message_type, offered, definition(message_type))
        self.note = ""
        if len({(qos.reliability, qos.durability) for qos in offered}) > 1:
            self.note = "its publishers offer different QoS: subscribed as the weakest of them"
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=self.depth,
            reliability=ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.VOLATILE,
        )
        if not self.best_effort and {qos.reliability for qos in offered} == {"reliable"}:
            profile.reliability = reliable
        if not self.best_effort and self.channel.latched:
            profile.durability = latched
        if self._subscription is not None:
            if profile == self._profile and before == message_type:
                return
            self.note = self.note or "the QoS of its publisher changed: subscribed anew"
        if before != message_type:
            joints = message_type in (JOINT_STATE, FLOAT_ARRAY)
            content = JointContent(message_type, self.joints, self.needed) if joints else None
            self.monitor = TopicMonitor(content, has_header=has_header(message_type))
            self.monitor.new_publishers(len(publishers))
        kind = python_type(message_type)
        with self._lock:  # messages that both receive are counted once
            new = self.node.create_subscription(
                kind, self.name, lambda _: None, profile, callback_group=self._group, raw=True
            )
            old, self._subscription = self._subscription, new
            if old is not None:
                self._drain(old, self._left)
            self._type, self._profile = kind, profile
        if old is not None:
            self.node.destroy_subscription(old)


def _message_key(message: Taken) -> tuple[int | None, int | None]:
    return message[1]["source_timestamp"], message[1]["publication_sequence_number"]


class TopicSet:
    """All topics to record; `say` takes a sentence on a topic that cannot be recorded."""

    def __init__(
        self, node: Node, settings: RecorderSettings, say: Callable[[str], object]
    ) -> None:
        self._node, self._say = node, say
        self._said: dict[str, str] = {}
        self._signals: list[WatchedTopic] = []
        self._extra: list[WatchedTopic] = []
        self.configure(settings)

    @property
    def topics(self) -> list[WatchedTopic]:
        """Return a new list of the topics, signals first, that another thread may iterate over."""
        return [*self._signals, *self._extra]

    def configure(self, settings: RecorderSettings) -> None:
        """Watch the signals of the configuration in `settings`."""
        new, old = signal_topics(self._node, settings), self._signals
        self._signals = new
        self.extend(settings)
        for topic in old:
            topic.close()

    def extend(self, settings: RecorderSettings) -> None:
        """Watch the extra topics in `settings`: the list now, matches as they appear."""
        old, self._extra = self._extra, []
        text = settings.extra_topics_regex
        self._expression = re.compile(text) if text else None
        self._depth = settings.queue_depth
        self._refused: set[str] = set()
        self._looked = float("-inf")
        listed = map(self._node.resolve_topic_name, filter(None, settings.extra_topics))
        signals = {topic.name for topic in self._signals}
        self._extra = [self._topic(name) for name in dict.fromkeys(listed) if name not in signals]
        for topic in old:
            topic.close()

    def look(self) -> None:
        """Look for publishers, and for topics that have appeared."""
        self._extra = [*self._extra, *self._new_topics()]
        for topic in self.topics:
            topic.look()
            if topic.problem and self._said.get(topic.name) != topic.problem:
                self._say(f"{topic.name}: {topic.problem}")
            self._said[topic.name] = topic.problem

    def close(self) -> None:
        """Unsubscribe from all."""
        for topic in self.topics:
            topic.close()

    def _new_topics(self) -> list[WatchedTopic]:
        """Return new topics that match the expression and have a publisher."""
        if self._expression is None or time.monotonic() - self._looked < _PERIOD:
            return []
        self._looked = time.monotonic()
        watched, matches = {topic.name for topic in self.topics}, []
        for name, types in self._node.get_topic_names_and_types():
            # A part that begins with an underscore is hidden, as those of services and actions.
            if name in watched or name in self._refused or "/_" in name:
                continue
            if not self._expression.search(name) or not self._node.count_publishers(name):
                continue
            if problem := why_unreadable(types[0]):
                self._refused.add(name)
                self._say(f"{name}: {problem}")
            else:
                matches.append(self._topic(name))
        return matches

    def _topic(self, name: str) -> WatchedTopic:
        return WatchedTopic(self._node, name, None, self._depth)


def signal_topics(node: Node, settings: RecorderSettings) -> list[WatchedTopic]:
    """Return the topics of joint states, effort, reference, link states and robot description.

    Relative names are in the node's namespace, and remapped; the robot description may be global.
    """
    signals, joints = SignalsSection(), tuple[str, ...]()
    if settings.configuration:
        configuration = read_configuration(node, settings.configuration)
        signals, joints = configuration.signals, tuple(configuration.robot.joints)
    sources = (
        ("position", signals.joint_states),
        ("effort", signals.effort_topic),
        ("position", signals.reference),
        ("position", signals.link_states),
    )
    needed: dict[str, set[str]] = {}
    named: set[str] = set()
    for quantity, source in sources:
        if source is not None:
            name = topic_of(source)
            # Without a configuration nobody knows what is needed.
            needed.setdefault(name, set()).update([quantity] if settings.configuration else [])
            named |= {name} if field_of(source) else set()
    topics = []
    for name, quantities in needed.items():
        fields = sorted(quantities)
        types = joint_types(fields, named_field=name in named)
        resolved, depth = node.resolve_topic_name(name), settings.queue_depth
        topics.append(WatchedTopic(node, resolved, types, depth, joints, fields))
    local_and_global = (ROBOT_DESCRIPTION, in_root(ROBOT_DESCRIPTION))
    descriptions = [
        WatchedTopic(node, name, [_STRING], _DESCRIPTIONS)
        for name in dict.fromkeys(map(node.resolve_topic_name, local_and_global))
    ]
    for topic in descriptions:
        topic.substitutes = [other for other in descriptions if other is not topic]
    return [*topics, *descriptions]


class RecentCounts:
    """Increase of the counts of a topic within the last `RECENT` seconds.

    A status takes its level from these: one late message does not make a long recording faulty.
    """

    def __init__(self) -> None:
        self._seen: deque[tuple[float, IntArray]] = deque()

    def since(self, status: TopicStatus, now: float) -> TopicStatus:
        """Return a status with the increase of its counts; `now`, s, must not decrease."""
        counts = np.array([getattr(status, name) for name in _COUNTED])
        if self._seen and np.any(counts < self._seen[-1][1]):
            self._seen.clear()  # counted from zero: a new recording, or another publisher
        self._seen.append((now, counts))
        while len(self._seen) > 1 and now - self._seen[1][0] >= RECENT:
            self._seen.popleft()
        begin, before = self._seen[0]
        recent = counts if now - begin < RECENT else counts - before
        rose = dict(zip(_COUNTED, recent.tolist(), strict=True))
        return TopicStatus(rate=status.rate, longest_gap=status.longest_gap, **rose)


def topic_diagnosis(
    name: str, topic: WatchedTopic, status: TopicStatus, recent: TopicStatus
) -> DiagnosticStatus:
    """Return the status of one topic: level from the `recent` counts, values from `status`."""
    monitor = topic.monitor
    latched = topic.channel is None or topic.channel.latched
    longest = max(_SILENT, _SILENT_PERIODS * (monitor.period or 0.0))
    errors = [topic.problem] if topic.problem else []
    if topic.had_publishers and topic.publishers == 0:
        errors.append(f"its publisher is gone; last message {monitor.silence:.1f} s ago")
    elif topic.had_publishers and not latched and monitor.silence > longest:
        errors.append(f"no message for {monitor.silence:.1f} s")
    warnings = []
    substituted = any(other.had_publishers for other in topic.substitutes)
    if not topic.had_publishers and not topic.problem and not substituted:
        warnings.append("nobody publishes it")
    if topic.note:
        warnings.append(topic.note)
    if topic.publishers > 1:
        warnings.append(f"{topic.publishers} publishers: lost messages cannot be counted")
    if monitor.content is not None:
        warnings += monitor.content.problems
    for counted, what in _INCIDENTS.items():
        if count := getattr(recent, counted):
            warnings.append(f"{count} messages {what}")
    if recent.gaps:
        longest_gap = f"the longest of the recording {recent.longest_gap:.3f} s"
        warnings.append(f"{recent.gaps} gaps; {longest_gap}")
    level = DiagnosticStatus.WARN if warnings else DiagnosticStatus.OK
    level = DiagnosticStatus.ERROR if errors else level
    sentence = "; ".join(errors + warnings) or f"{status.rate:.1f} Hz"
    counts = ("publishers", "received", "recorded", "lost", "late", "gaps", "malformed", "bytes")
    values = {
        "rate (Hz)": f"{status.rate:.1f}",
        **{name: getattr(status, name) for name in counts},
        "longest gap (s)": f"{status.longest_gap:.4f}",
        "backward stamps": status.backward,
    }
    return diagnostic_status(level, f"{name}: {topic.name}", topic.name, sentence, values)
