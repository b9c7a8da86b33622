"""All topics of the recorder: the robot's signals and the extra ones, also those that appear."""

import re
import time
from collections.abc import Callable

from rclpy.node import Node

from idim_iv_ros.configuration import SignalsSection
from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.parameters import read_configuration
from idim_iv_ros.nodes.recorder.installed_types import definition, python_type
from idim_iv_ros.nodes.recorder.settings import RecorderSettings
from idim_iv_ros.nodes.recorder.watched_topic import STRING, WatchedTopic
from idim_iv_ros.recording.bags.definitions import FLOAT_ARRAY, JOINT_STATE, ROS2_CONTROL
from idim_iv_ros.recording.topic_names import ROBOT_DESCRIPTION, in_root
from idim_iv_ros.signal_source import field_of, topic_of

_PERIOD = 1.0  # s between two looks for topics that match
_DESCRIPTIONS = 10  # descriptions of the robot that wait


class TopicSet:
    """Topics that are watched.

    Parameters
    ----------
    node : Node
    settings : RecorderSettings
    say : callable
        Takes one line, once for each topic that cannot be recorded.

    Raises
    ------
    UsageError
        The configuration cannot be read.
    """

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
        """Signals first; a new list each time, so that another thread may go through it."""
        return [*self._signals, *self._extra]

    @property
    def names(self) -> set[str]:
        """Fully qualified names of the topics."""
        return {topic.name for topic in self.topics}

    def configure(self, settings: RecorderSettings) -> None:
        """Watch the signals of another configuration.

        Raises
        ------
        UsageError
            The configuration cannot be read.
        """
        new, old = signal_topics(self._node, settings), self._signals
        self._signals = new
        self.extend(settings)
        for topic in old:
            topic.close()

    def extend(self, settings: RecorderSettings) -> None:
        """Watch other extra topics: those of the list now, those that match when they appear."""
        old, self._extra = self._extra, []
        text = settings.extra_topics_regex
        self._expression = re.compile(text) if text else None
        self._depth = settings.queue_depth
        self._refused: set[str] = set()
        self._looked = float("-inf")
        listed = map(self._node.resolve_topic_name, filter(None, settings.extra_topics))
        self._extra = [
            self._topic(name) for name in dict.fromkeys(listed) if name not in self.names
        ]
        for topic in old:
            topic.close()

    def look(self) -> None:
        """Look for publishers, and for topics that have appeared."""
        self._extra = [*self._extra, *self._appeared()]
        for topic in self.topics:
            topic.look()
            if topic.problem and self._said.get(topic.name) != topic.problem:
                self._say(f"{topic.name}: {topic.problem}")
            self._said[topic.name] = topic.problem

    def close(self) -> None:
        """Unsubscribe from all."""
        for topic in self.topics:
            topic.close()

    def _appeared(self) -> list[WatchedTopic]:
        """Topics that match the expression, have a publisher and are not watched yet."""
        if self._expression is None or time.monotonic() - self._looked < _PERIOD:
            return []
        self._looked = time.monotonic()
        watched, matches = self.names, []
        for name, types in self._node.get_topic_names_and_types():
            # A part that begins with an underscore is hidden, as those of services and actions.
            if name in watched or name in self._refused or "/_" in name:
                continue
            if not self._expression.search(name) or not self._node.count_publishers(name):
                continue
            try:
                python_type(types[0])
                definition(types[0])
            except DataError as error:
                self._refused.add(name)
                self._say(f"{name}: {error}")
                continue
            matches.append(self._topic(name))
        return matches

    def _topic(self, name: str) -> WatchedTopic:
        return WatchedTopic(self._node, name, None, (), (), self._depth)


def signal_topics(node: Node, settings: RecorderSettings) -> list[WatchedTopic]:
    """Return joint states, effort, reference, link states and robot description, remapped.

    Relative names are in the namespace of the node; the description of the robot is the global one
    where its namespace has none.

    Raises
    ------
    UsageError
        The configuration cannot be read.
    """
    names, joints = SignalsSection(), tuple[str, ...]()
    if settings.configuration:
        configuration = read_configuration(node, settings.configuration)
        names, joints = configuration.signals, tuple(configuration.robot.joints)
    needed: dict[str, list[str]] = {topic_of(names.joint_states): ["position"]}
    if names.effort_topic is not None:
        needed.setdefault(topic_of(names.effort_topic), []).append("effort")
    if names.reference is not None:
        needed.setdefault(topic_of(names.reference), []).append("position")
    if names.link_states is not None:
        needed.setdefault(topic_of(names.link_states), []).append("position")
    if not settings.configuration:
        needed[topic_of(names.joint_states)] = []
    given = (names.joint_states, names.effort_topic, names.reference, names.link_states)
    with_field = {topic_of(source) for source in given if source and field_of(source)}
    topics = []
    for name, fields in needed.items():
        # A field that is named may belong to any type.
        types = None if name in with_field else [JOINT_STATE, *ROS2_CONTROL]
        if types is not None and fields == ["effort"]:
            types.append(FLOAT_ARRAY)
        resolved = node.resolve_topic_name(name)
        depth = settings.queue_depth
        topics.append(WatchedTopic(node, resolved, types, joints, sorted(set(fields)), depth))
    local_and_global = (ROBOT_DESCRIPTION, in_root(ROBOT_DESCRIPTION))
    descriptions = [
        WatchedTopic(node, name, [STRING], (), (), _DESCRIPTIONS)
        for name in dict.fromkeys(map(node.resolve_topic_name, local_and_global))
    ]
    for topic in descriptions:
        topic.substitutes = [other for other in descriptions if other is not topic]
    return [*topics, *descriptions]
