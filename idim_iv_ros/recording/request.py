"""What is read of a bag: which quantities of which joints, from which field of which topic."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from idim_iv_ros.recording.bags.cdr import MessageBatch
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.bags.joint_message_type import JointMessageType, may_hold_joints
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
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
    def own(self) -> "Request":
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

    def likeliest(self, descriptions: Mapping[str, str]) -> str | None:
        """Of the descriptions that a bag holds, by topic, that of the robot."""
        return next(filter(None, map(descriptions.get, self.descriptions)), None)

    def sources(self, topic: str) -> list[str]:
        """Sources that are read from a topic."""
        return [source for source in self.fields if topic_of(source) == topic]


def in_bag(bag: Bag, request: Request) -> Request:
    """Return the request with the full names of its topics in this bag.

    Raises
    ------
    UsageError, DataError
        No such bag, or several topics may be meant.
    """
    if all(name.startswith("/") for name in request.named.values()):
        return request.own
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
    ).own


def add_batch(
    readers: dict[str, JointMessageReader],
    bag: Bag,
    request: Request,
    topic: str,
    batch: MessageBatch,
) -> None:
    """Give the messages of a topic to the reader of each source that is read from it.

    Raises
    ------
    UsageError, DataError
        They hold no quantities of joints, or not in the field that is named.
    """
    for source in request.sources(topic):
        if source not in readers:
            readers[source] = _reader_of(bag, source, request)
        readers[source].add(batch)


def _reader_of(bag: Bag, source: str, request: Request) -> JointMessageReader:
    """Return an empty reader for a source whose topic was just met."""
    name = bag.topics[topic_of(source)]
    asked = source == request.reference
    kind = JointMessageType(name, bag.definitions.get(name), field_of(source), asked)
    kind.require_readable(bag.path, topic_of(source))
    return JointMessageReader(source, kind, request.joints, sorted(request.fields[source]))
