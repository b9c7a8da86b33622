"""All topics of the recorder: the robot's signals and the extra ones, also those that appear."""

from collections.abc import Callable

from rclpy.node import Node

from idim_iv_ros.nodes.own_topics import read_own
from idim_iv_ros.nodes.recorder.extra_topics import ExtraTopics
from idim_iv_ros.nodes.recorder.settings import RecorderSettings
from idim_iv_ros.nodes.recorder.watched_topic import WatchedTopic, recorder_topics


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
            read_own(node, settings.configuration)  # in one line, if it names what is no topic
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
