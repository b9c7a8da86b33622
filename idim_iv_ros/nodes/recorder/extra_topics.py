"""Topics that are recorded besides the robot's signals: named one by one, or by an expression."""

import re
import time
from collections.abc import Callable, Collection

from rclpy.node import Node

from idim_iv_ros.errors import DataError
from idim_iv_ros.nodes.recorder.installed_types import definition, python_type
from idim_iv_ros.nodes.recorder.settings import RecorderSettings
from idim_iv_ros.nodes.recorder.watched_topic import WatchedTopic

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
        found = []
        for name, types in self._node.get_topic_names_and_types():
            known = name in watched or name in self._refused
            # A part that begins with an underscore is hidden, as those of services and actions.
            if known or "/_" in name or not self._expression.search(name):
                continue
            if not self._node.get_publishers_info_by_topic(name):
                continue
            try:
                python_type(types[0])
                definition(types[0])
            except DataError as error:
                self._refused.add(name)
                self._say(f"{name}: {error}")
                continue
            found.append(self._topic(name))
        return found

    def _topic(self, name: str) -> WatchedTopic:
        return WatchedTopic(self._node, name, None, (), (), self._depth)
