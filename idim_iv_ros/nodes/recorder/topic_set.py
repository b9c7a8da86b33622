"""All topics of the recorder: the robot's signals and the extra ones, also those that appear."""

import re
import time
from collections.abc import Callable, Collection

from rclpy.node import Node

from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.parameters import read_configuration
from idim_iv_ros.nodes.recorder.installed_types import definition, python_type
from idim_iv_ros.nodes.recorder.settings import RecorderSettings
from idim_iv_ros.nodes.recorder.watched_topic import WatchedTopic, recorder_topics

_PERIOD = 1.0  # s between two looks for topics that match


class ExtraTopics:
    """Finds extra topics, also those that appear later.

    Parameters
    ----------
    node : Node
    settings : RecorderSettings
    say : callable
        Takes one line for each topic that matches and cannot be recorded.
    """

    def __init__(
        self, node: Node, settings: RecorderSettings, say: Callable[[str], object]
    ) -> None:
        self._node, self._depth, self._say = node, settings.queue_depth, say
        self._named = [name for name in settings.extra_topics if name]
        text = settings.extra_topics_regex
        self._expression = re.compile(text) if text else None
        self._refused: set[str] = set()
        self._looked = float("-inf")

    def named(self, watched: Collection[str]) -> list[WatchedTopic]:
        """Topics of the list that are not `watched` yet."""
        names = dict.fromkeys(self._node.resolve_topic_name(name) for name in self._named)
        return [self._topic(name) for name in names if name not in watched]

    def look(self, watched: Collection[str]) -> list[WatchedTopic]:
        """Topics that match, have a publisher and are not `watched` yet."""
        if self._expression is None or time.monotonic() - self._looked < _PERIOD:
            return []
        self._looked = time.monotonic()
        matches = []
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
        self._others: list[WatchedTopic] = []
        if settings.configuration:
            read_configuration(node, settings.configuration)  # refused if it names no topic
        self._signals = recorder_topics(node, settings)
        self._extra = ExtraTopics(node, settings, say)
        self._others = self._extra.named(self.names)

    @property
    def topics(self) -> list[WatchedTopic]:
        """Signals first; a new list each time, so that another thread may go through it."""
        return [*self._signals, *self._others]

    @property
    def names(self) -> set[str]:
        """Fully qualified."""
        return {topic.name for topic in self.topics}

    def look(self) -> None:
        """Look for publishers, and for topics that have appeared."""
        self._others = [*self._others, *self._extra.look(self.names)]
        for topic in self.topics:
            topic.look()
            if topic.problem and self._said.get(topic.name) != topic.problem:
                self._say(f"{topic.name}: {topic.problem}")
            self._said[topic.name] = topic.problem

    def configure(self, settings: RecorderSettings) -> None:
        """Watch the signals of another configuration.

        Raises
        ------
        UsageError
            The configuration cannot be read.
        """
        new, old = recorder_topics(self._node, settings), self._signals
        self._signals = new
        self.extend(settings)
        for topic in old:
            topic.close()

    def extend(self, settings: RecorderSettings) -> None:
        """Watch other extra topics."""
        old, self._others = self._others, []
        self._extra = ExtraTopics(self._node, settings, self._say)
        self._others = self._extra.named(self.names)
        for topic in old:
            topic.close()

    def close(self) -> None:
        """Unsubscribe from all."""
        for topic in self.topics:
            topic.close()
