"""The recorder's topics: subscribed as their publishers offer them, emptied without executor."""

import threading
from collections.abc import Sequence
from contextlib import suppress

from rclpy.callback_groups import CallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.recorder.installed_types import definition, has_header, python_type
from idim_iv_ros.nodes.recorder.topic_monitor import JointContent, Taken, TopicMonitor
from idim_iv_ros.recording.bags.definitions import FLOAT_ARRAY, JOINT_STATE, ROS2_CONTROL
from idim_iv_ros.recording.writing.write import OfferedQos, TopicChannel

_AT_ONCE = 20_000

STRING = "std_msgs/msg/String"


class NeverExecuted(CallbackGroup):
    """Keeps its subscriptions out of every executor: they are emptied by hand."""

    def can_execute(self, entity: object) -> bool:
        """Return False."""
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Return False."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Nothing was begun."""


class WatchedTopic:
    """Subscription, channel and counts of one topic.

    Parameters
    ----------
    node : Node
    name : str
        Fully qualified.
    types : sequence of str or None
        Message types that can be used; None: any that is installed.
    joints, needed
        As in JointContent.
    depth : int
        Messages that the middleware keeps.
    best_effort : bool
        Whether nothing is sent again for this subscription, nor a message from before it, whatever
        the publishers offer.

    Attributes
    ----------
    problem : str
        Why the topic is not recorded, empty if it is or nobody publishes it.
    publishers : int
    had_publishers : bool
        Whether there ever was one.
    too_large : int
        Messages left out for their size.
    substitutes : sequence of WatchedTopic
        Each does as well where nobody publishes this one.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        types: Sequence[str] | None,
        joints: Sequence[str],
        needed: Sequence[str],
        depth: int,
        *,
        best_effort: bool = False,
    ) -> None:
        self.name = name
        self.joints, self.needed = joints, needed
        self.problem = self.note = ""
        self.publishers = self.too_large = 0
        self.had_publishers = False
        self.substitutes: Sequence[WatchedTopic] = ()
        self.monitor = TopicMonitor(None, has_header=False)
        self.channel: TopicChannel | None = None
        self._node, self._types, self._depth = node, types, depth
        self._best_effort = best_effort
        self._group = NeverExecuted()
        self._lock = threading.Lock()
        self._subscription: Subscription | None = None
        self._type: object = None
        self._gids: frozenset[bytes] = frozenset()
        self._left: list[Taken] = []

    @property
    def absence(self) -> str:
        """Why nothing came, where that is unusual; else empty."""
        if self.problem:
            return f"{self.name}: {self.problem}"
        if self._types == [STRING]:  # the description; a configuration may have it instead
            return ""
        if not self.had_publishers:
            return f"nobody publishes {self.name}"
        return f"nothing came on {self.name}" if self._types else ""

    def look(self) -> None:
        """Look for publishers: subscribe to the first, and again where their QoS changed."""
        found = self._node.get_publishers_info_by_topic(self.name)
        usable = [each for each in found if self._types is None or each.topic_type in self._types]
        self.publishers = len(found)
        self.problem = ""
        if found and not usable and self._types is not None:
            plain = " or ".join(kind for kind in self._types if kind not in ROS2_CONTROL)
            state = ", or a state of control_msgs" if len(self._types) > len(ROS2_CONTROL) else ""
            self.problem = f"it is {found[0].topic_type}; {plain} is needed{state}: not recorded"
        if not usable:
            return
        try:
            python_type(usable[0].topic_type)
            definition(usable[0].topic_type)
        except DataError as error:
            self.problem = str(error)
            return
        usable = [recording for recording in usable if recording.topic_type == usable[0].topic_type]
        self.had_publishers = True
        gids = frozenset(bytes(each.endpoint_gid) for each in usable)
        if gids != self._gids:
            self._gids = gids
            self.monitor.new_publishers(len(gids))
            self._subscribe(usable)

    def take(self, largest: int) -> list[Taken]:
        """Everything that arrived; messages with more than `largest` bytes are left out."""
        with self._lock:
            fresh: list[Taken] = []
            if self._subscription is not None:
                self._drain(self._subscription, fresh)
            if self._left:
                seen = set(map(_identity, self._left))
                fresh = [entry for entry in fresh if _identity(entry) not in seen]
            taken, self._left = self._left + fresh, []
        if any(len(message) > largest for message, _ in taken):
            fitting = [each for each in taken if len(each[0]) <= largest]
            self.too_large += len(taken) - len(fitting)
            return fitting
        return taken

    def close(self) -> None:
        """Unsubscribe."""
        with self._lock:
            if self._subscription is not None:
                self._node.destroy_subscription(self._subscription)
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
        """Subscribe reliable, and transient local, only where all publishers are (rosbag2)."""
        message_type = publishers[0].topic_type
        offered = tuple(_offered(publisher) for publisher in publishers)
        channel = TopicChannel(self.name, message_type, offered, definition(message_type))
        before, self.channel = self.channel, channel
        kinds = {qos.reliability for qos in offered}, {qos.durability for qos in offered}
        self.note = (
            "its publishers offer different QoS: subscribed as the weakest of them"
            if max(map(len, kinds)) > 1
            else ""
        )
        if before is not None and self._subscription is not None:
            same = self._request(before) == self._request(channel)
            if same and before.message_type == message_type:
                return
            self.note = self.note or "the QoS of its publisher changed: subscribed anew"
        if before is None or before.message_type != message_type:
            content = (
                JointContent(message_type, self.joints, self.needed)
                if message_type in (JOINT_STATE, FLOAT_ARRAY)
                else None
            )
            self.monitor = TopicMonitor(content, has_header=has_header(message_type))
            self.monitor.new_publishers(len(publishers))
        self._replace(message_type, self._request(channel))

    def _request(self, channel: TopicChannel) -> tuple[bool, bool]:
        """Whether to subscribe reliable, and transient local."""
        if self._best_effort:
            return False, False
        reliable = all(qos.reliability == "reliable" for qos in channel.offered)
        return reliable, channel.latched

    def _replace(self, message_type: str, request: tuple[bool, bool]) -> None:
        reliable, transient_local = request
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        durability = (
            DurabilityPolicy.TRANSIENT_LOCAL if transient_local else DurabilityPolicy.VOLATILE
        )
        qos = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=self._depth,
            reliability=policy,
            durability=durability,
        )
        type_ = python_type(message_type)
        with self._lock:
            # What the old subscription still holds is taken over; what both got counts once.
            new = self._node.create_subscription(
                type_, self.name, _never, qos, callback_group=self._group, raw=True
            )
            old, self._subscription = self._subscription, new
            if old is not None:
                self._drain(old, self._left)
            self._type = type_
        if old is not None:
            self._node.destroy_subscription(old)


def _never(_: bytes) -> None:
    """No executor calls this."""


def _identity(message: Taken) -> tuple[int | None, int | None]:
    return message[1]["source_timestamp"], message[1]["publication_sequence_number"]


def _offered(publisher: TopicEndpointInfo) -> OfferedQos:
    qos = publisher.qos_profile
    return OfferedQos(
        "reliable" if qos.reliability == ReliabilityPolicy.RELIABLE else "best_effort",
        "transient_local" if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL else "volatile",
        qos.depth or 10,
    )
