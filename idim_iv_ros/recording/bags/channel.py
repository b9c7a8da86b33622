"""How a topic is described in a bag: type, embedded definition, and the QoS it was offered with."""

from dataclasses import dataclass
from functools import cache

from mcap.writer import Writer
from rosbags.typesys import Stores, get_typestore

_FOREVER = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True)
class OfferedQos:
    """Quality of service of one publisher, as rosbag2 writes it.

    Attributes
    ----------
    reliability : str
        ``reliable`` or ``best_effort``.
    durability : str
        ``volatile`` or ``transient_local``.
    depth : int
        Of the publisher's history; discovery does not tell it, and it does not matter for replay.
    """

    reliability: str = "reliable"
    durability: str = "volatile"
    depth: int = 10

    def yaml(self, indent: str = "") -> str:
        """Return one item of the YAML list ``offered_qos_profiles``."""
        durations = [
            line
            for name in ("deadline", "lifespan", "liveliness_lease_duration")
            for line in (f"{name}:", *(f"  {unit}: {value}" for unit, value in _FOREVER.items()))
        ]
        lines = [
            "history: keep_last",
            f"depth: {self.depth}",
            f"reliability: {self.reliability}",
            f"durability: {self.durability}",
            *durations,
            "liveliness: automatic",
            "avoid_ros_namespace_conventions: false",
        ]
        return f"{indent}- " + f"\n{indent}  ".join(lines) + "\n"


@dataclass(frozen=True)
class TopicChannel:
    """One topic of a bag.

    Attributes
    ----------
    name, message_type : str
        ``/joint_states``, ``sensor_msgs/msg/JointState``.
    offered : tuple of OfferedQos
        One for each publisher.
    """

    name: str
    message_type: str
    offered: tuple[OfferedQos, ...] = (OfferedQos(),)

    @property
    def latched(self) -> bool:
        """Whether late subscribers get the last message: every publisher is transient local."""
        return bool(self.offered) and all(
            qos.durability == "transient_local" for qos in self.offered
        )

    @property
    def type_hash(self) -> str:
        """Hash of the type's description (REP 2011)."""
        return _definition(self.message_type)[1]

    def register(self, writer: Writer) -> int:
        """Describe the topic in an MCAP file and return its channel."""
        text, hash_ = _definition(self.message_type)
        schema = writer.register_schema(self.message_type, "ros2msg", text.encode())
        metadata = {
            "offered_qos_profiles": "".join(qos.yaml() for qos in self.offered),
            "topic_type_hash": hash_,
        }
        return int(writer.register_channel(self.name, "cdr", schema, metadata))


def is_defined(message_type: str) -> bool:
    """Whether the definition of a message type is known."""
    return message_type in get_typestore(Stores.ROS2_JAZZY).fielddefs


@cache
def _definition(message_type: str) -> tuple[str, str]:
    """Text with all dependencies, and hash."""
    store = get_typestore(Stores.ROS2_JAZZY)
    text, _ = store.generate_msgdef(message_type, ros_version=2)
    return text, store.hash_rihs01(message_type)
