"""What is read of a bag: which quantities of which joints, from which field of which topic."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from idim_iv_ros.recording.bags.cdr import MessageBatch
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.bags.joint_message_type import JointMessageType, may_hold_joints
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
from idim_iv_ros.recording.other_topics import robot_description
from idim_iv_ros.recording.topic_names import descriptions_of, topics_in_bag
from idim_iv_ros.signal_source import field_of, topic_of, with_field


@dataclass(frozen=True)
class Request:
    """What to read of a bag: joints, topics, and which joints are known to be prismatic.

    A topic may be named with a field, ``topic#field``. `effort` is None where none is recorded.
    """

    joints: Sequence[str]
    joint_states: str
    effort: str | None
    reference: str | None
    prismatic: Collection[str] = ()
    link_states: str | None = None
    own_topics: Mapping[str, str] = field(default_factory=dict)

    @property
    def named(self) -> dict[str, str]:
        """Topic of each key of a configuration that names one."""
        keys = ("joint_states", "effort", "reference", "link_states")
        return {key: name for key in keys if (name := getattr(self, key)) is not None}

    @property
    def fields(self) -> dict[str, set[str]]:
        """Fields to read of each topic."""
        fields: dict[str, set[str]] = {self.joint_states: {"position", "velocity"}}
        if self.effort is not None:
            fields.setdefault(self.effort, set()).add("effort")
        if self.reference is not None:
            fields.setdefault(self.reference, set()).update(("position", "velocity"))
        if self.link_states is not None:
            fields.setdefault(self.link_states, set()).add("position")
        return fields

    @property
    def with_reference_field(self) -> "Request":
        """The same with a source of its own for the reference.

        One controller_state may hold what was asked for and what was measured.
        """
        reference = self.reference
        measured = (self.joint_states, self.effort, self.link_states)
        if reference is None or reference not in measured or field_of(reference) is not None:
            return self
        return replace(self, reference=with_field(reference, "reference"))

    @property
    def topics(self) -> list[str]:
        """Topics that are read."""
        return list(dict.fromkeys(map(topic_of, self.fields)))

    @property
    def descriptions(self) -> list[str]:
        """Topics that may hold the robot's description, the likeliest first."""
        return descriptions_of(topic_of(self.joint_states), self.own_topics)


def in_bag(bag: Bag, request: Request) -> Request:
    """Return the request with the full names of its topics in this bag.

    Raises UsageError or DataError: no such bag, or several topics may be meant.
    """
    if all(name.startswith("/") for name in request.named.values()):
        return request.with_reference_field
    # A field that is named may belong to any type.
    any_type = any(field_of(name) for name in request.named.values())
    kinds = bag.unread().known_topics().items()
    topics = [name for name, kind in kinds if any_type or may_hold_joints(kind)]
    named = {key: topic_of(name) for key, name in request.named.items()}
    full_names = topics_in_bag(bag.path, named, topics, request.own_topics)

    def full(source: str) -> str:
        field_, topic = field_of(source), full_names[topic_of(source)]
        return topic if field_ is None else with_field(topic, field_)

    effort, reference, link_states = request.effort, request.reference, request.link_states
    return replace(
        request,
        joint_states=full(request.joint_states),
        effort=None if effort is None else full(effort),
        reference=None if reference is None else full(reference),
        link_states=None if link_states is None else full(link_states),
    ).with_reference_field


@dataclass
class BagMessages:
    """What was read of a bag so far.

    `request`: with the full names of its topics. `readers`: messages of each source that was met.
    """

    bag: Bag
    request: Request
    readers: dict[str, JointMessageReader] = field(default_factory=dict)
    _descriptions: dict[str, str] = field(default_factory=dict)

    @property
    def topics(self) -> set[str]:
        """Topics of the bag that are read."""
        return {*self.request.topics, *self.request.descriptions}

    @property
    def description(self) -> str | None:
        """The robot's description, of the likeliest topic that has one."""
        return next(filter(None, map(self._descriptions.get, self.request.descriptions)), None)

    def add(self, topic: str, batch: MessageBatch) -> None:
        """Take messages of a topic, for each source that is read from it.

        Raises UsageError or DataError: they hold no quantities of joints, or not in the field that
        is named.
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
        """Give up the messages that arrived before a time, ns."""
        earlier = {source: reader.before(arrival) for source, reader in self.readers.items()}
        return replace(self, readers=earlier)
