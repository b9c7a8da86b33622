"""A request for topics and quantities of a bag, with names resolved as ROS nodes resolve them.

A topic with a leading slash is meant as it is written. One without is relative: a node in the
namespace ``/left`` records ``joint_states`` as ``/left/joint_states``, and the same configuration
reads it again in the bag.
"""

import re
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from xml.etree import ElementTree

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.bags.bag_file import MessageBatch
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.bags.joint_message_type import (
    CONTROLLER_STATE,
    JOINT_STATE,
    JointMessageType,
    may_hold_joints,
)
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
from idim_iv_ros.signal_source import field_of, topic_of, with_field

ROBOT_DESCRIPTION = "robot_description"


def in_root(name: str) -> str:
    """Return the full name of a topic as a node without a namespace resolves it."""
    return name if name.startswith("/") else f"/{name}"


_WORDS = ("reference", "ref", "command", "cmd", "desired", "target", "setpoint", "goal")
_QUANTITIES = {
    "joint_states": ("position", "velocity"),
    "effort": ("effort",),
    "reference": ("position", "velocity"),
    "link_states": ("position",),
}


@dataclass(frozen=True)
class Request:
    """Joints and topics to read of a bag; a topic may have a field, ``topic#field``."""

    joints: Sequence[str]
    joint_states: str
    effort: str | None  # None for robots without efforts
    reference: str | None
    prismatic: Collection[str] = ()  # joints that are known to be
    link_states: str | None = None
    # Full names of the calling node, by relative name.
    node_topics: Mapping[str, str] = field(default_factory=dict)

    @property
    def named(self) -> dict[str, str]:
        """Return the topic of each configuration key that is given."""
        return {key: name for key in _QUANTITIES if (name := getattr(self, key)) is not None}

    @property
    def fields(self) -> dict[str, set[str]]:
        """Return the quantities to read of each topic."""
        fields: dict[str, set[str]] = {}
        for key, source in self.named.items():
            fields.setdefault(source, set()).update(_QUANTITIES[key])
        return fields

    @property
    def topics(self) -> list[str]:
        """Return the topics to read, without fields."""
        return list(dict.fromkeys(map(topic_of, self.fields)))

    @property
    def descriptions(self) -> list[str]:
        """Return topics that may hold the robot's description, the likeliest first.

        That of the calling node, then in the namespace of the joint states, and in those around it.
        """
        likely = [self.node_topics.get(ROBOT_DESCRIPTION, "")]
        namespace = topic_of(self.joint_states)
        while namespace:
            namespace = namespace.rpartition("/")[0]
            likely.append(f"{namespace}/{ROBOT_DESCRIPTION}")
        return list(dict.fromkeys(filter(None, likely)))


def in_bag(bag: Bag, request: Request) -> Request:
    """Return the request with the full names of its topics in this bag.

    A reference that shares the topic of a measurement gets a source of its own.

    Raises UsageError or DataError: no such bag, or several topics end with a relative name.
    """
    relative = {key: topic_of(name) for key, name in request.named.items() if name[:1] != "/"}
    full = _with_full_names(bag, request, relative) if relative else request
    # One controller_state may hold references and measurements.
    shared, measured = full.reference, (full.joint_states, full.effort, full.link_states)
    if shared is None or shared not in measured or field_of(shared) is not None:
        return full
    return replace(full, reference=with_field(shared, "reference"))


def _with_full_names(bag: Bag, request: Request, relative: Mapping[str, str]) -> Request:
    """Return the request with the full names of its `relative` topics, by configuration key.

    All are resolved in one namespace, lest the reference of another robot is used: that of the
    calling node (``/`` without one) if the first name is there, else that of the only topic whose
    name ends with the first name. Topics that are not in the bag get names, too.
    """
    # A field that is named may belong to any type.
    any_type = any(field_of(name) for name in request.named.values())
    topics = [name for name, kind in bag.topic_types().items() if any_type or may_hold_joints(kind)]
    key, first = next(iter(relative.items()))
    resolved = {name: request.node_topics.get(name, in_root(name)) for name in relative.values()}
    candidates = sorted(topic for topic in topics if topic.endswith(f"/{first}"))
    if resolved[first] not in topics and candidates:
        if len(candidates) > 1:
            rest = ", ".join(other for other in resolved if other != first)
            others = f", and the same for {rest}" if rest else ""
            raise DataError(
                f"{bag.path}: signals.{key}: {first} may be {' or '.join(candidates)}: write the "
                f"full name of your robot's, as `{key}: {candidates[0]}`, under signals{others}"
            )
        namespace = candidates[0].removesuffix(first)
        resolved = {name: namespace + name for name in resolved}
    sources: dict[str, Any] = {
        key: resolved[name] + request.named[key].removeprefix(name)
        for key, name in relative.items()
    }
    return replace(request, **sources)


@dataclass
class BagMessages:
    """Messages read of a bag so far, by source; the `request` has full names."""

    bag: Bag
    request: Request
    readers: dict[str, JointMessageReader] = field(default_factory=dict)
    _descriptions: dict[str, str] = field(default_factory=dict)

    @property
    def topics(self) -> set[str]:
        """Return the topics of the bag to read."""
        return {*self.request.topics, *self.request.descriptions}

    @property
    def description(self) -> str | None:
        """Return the robot's description, of the likeliest topic that has one."""
        return next(filter(None, map(self._descriptions.get, self.request.descriptions)), None)

    def add(self, topic: str, batch: MessageBatch) -> None:
        """Add messages of a topic to every source that reads it.

        Raises UsageError or DataError: they hold no joint quantities, or not in that field.
        """
        if topic in self.request.descriptions:
            text = robot_description(batch)
            self._descriptions.update({} if text is None else {topic: text})
        for source, quantities in self.request.fields.items():
            if topic_of(source) != topic:
                continue
            if source not in self.readers:
                name, asked = self.bag.topics[topic], source == self.request.reference
                schema = self.bag.definitions.get(name)
                kind = JointMessageType(name, schema, field_of(source), asked)
                kind.require_readable(self.bag.path, topic)
                self.readers[source] = JointMessageReader(
                    source, kind, self.request.joints, sorted(quantities)
                )
            self.readers[source].add(batch)

    def before(self, arrival: int) -> "BagMessages":
        """Remove the messages that arrived before a time, ns, and return them."""
        earlier = {source: reader.before(arrival) for source, reader in self.readers.items()}
        return replace(self, readers=earlier)


def robot_description(batch: MessageBatch) -> str | None:
    """Return the text of the last std_msgs/String of a batch; None for another type."""
    message = batch.message(len(batch) - 1)
    try:
        (size,) = struct.unpack_from("<I" if message[1] == 1 else ">I", message, 4)
        return message[8 : 8 + size].rstrip(b"\0").decode("utf-8")
    except (struct.error, IndexError, UnicodeDecodeError):
        return None


def prismatic_joints(urdf: str) -> frozenset[str]:
    """Return the names of the prismatic joints of a URDF; none for a text that is no URDF."""
    try:
        root = ElementTree.fromstring(urdf)
    except (ElementTree.ParseError, ValueError):
        return frozenset()
    return frozenset(e.get("name", "") for e in root.iter("joint") if e.get("type") == "prismatic")


def unused_references(bag: Bag, used: Sequence[str], joints: Sequence[str]) -> tuple[str, ...]:
    """Return the topics of a bag that hold positions of all joints, likely references first.

    The bag must have been read before; `used` are sources that are used already.
    """
    measured = set(map(topic_of, used))
    # What a controller was asked for is a reference, also of the topic that gives what it measured.
    kinds = {
        name: JointMessageType(kind, bag.definitions.get(kind), reference=True)
        for name, kind in bag.topics.items()
        if kind == CONTROLLER_STATE or (kind == JOINT_STATE and name not in measured)
    }
    references: list[tuple[bool, bool, str]] = []  # the likeliest is the least
    waiting = set(kinds)
    for topic, batch in bag.unread().batches(set(kinds)) if kinds else ():
        if topic in waiting and len(batch):
            reader = JointMessageReader(topic, kinds[topic], joints, ["position"])
            reader.add(batch)
            complete = np.isfinite(reader.finish().values["position"]).any(axis=0).all()
            plain = kinds[topic].name == JOINT_STATE
            if complete:
                references.append((plain, not sounds_like_reference(topic), topic))
            if complete or plain:  # a controller may not be active yet
                waiting.discard(topic)
        if not waiting:
            break
    return tuple(topic for *_, topic in sorted(references))


def sounds_like_reference(topic: str) -> bool:
    """Return whether a topic's name has a word for references: ``/arm/joint_commands``."""
    return any(word.removesuffix("s") in _WORDS for word in re.split(r"[^a-z]+", topic.lower()))
