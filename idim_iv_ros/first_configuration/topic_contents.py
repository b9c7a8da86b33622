"""What the topics of a bag hold, joint by joint, before anything is known of the robot."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.recording.bags.cdr import FLOAT_ARRAY, JOINT_STATE, read_layout
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
from idim_iv_ros.recording.other_topics import robot_description
from idim_iv_ros.recording.read import DESCRIPTION


@dataclass(frozen=True)
class JointContents:
    """What one JointState topic holds of one joint.

    Attributes
    ----------
    lowest, highest : float or None
        Positions, rad (m); None where it has none.
    largest_effort : float or None
        In the unit of the driver; None where it has none, 0 where all are zero.
    """

    lowest: float | None
    highest: float | None
    largest_effort: float | None

    @property
    def range(self) -> float:
        """Distance over which the joint moves, rad (m)."""
        return 0.0 if self.lowest is None or self.highest is None else self.highest - self.lowest


@dataclass(frozen=True)
class TopicContents:
    """One topic of a bag that can hold joint quantities.

    Attributes
    ----------
    name : str
    messages : int
    rate : float
        Messages per second.
    joints : dict of str to JointContents
        Empty for an array of numbers.
    numbers : int
        Length of an array of numbers; 0 for joint states.
    """

    name: str
    messages: int
    rate: float
    joints: dict[str, JointContents]
    numbers: int = 0

    def with_position(self) -> set[str]:
        """Joints of which there are positions."""
        return {name for name, each in self.joints.items() if each.lowest is not None}

    def with_effort(self) -> set[str]:
        """Joints of which some effort is not zero."""
        return {name for name, each in self.joints.items() if each.largest_effort}


@dataclass(frozen=True)
class BagContents:
    """Topics of one bag.

    Attributes
    ----------
    path : Path
    topics : tuple of TopicContents
    unreadable : dict of str to str
        Types of the other topics, by name.
    description : str or None
        URDF on /robot_description.
    """

    path: Path
    topics: tuple[TopicContents, ...]
    unreadable: dict[str, str]
    description: str | None


def read_contents(path: Path) -> BagContents:
    """Look through a bag.

    Raises
    ------
    UsageError, DataError
        No such bag, or not one.
    """
    bag, description = Bag(path), None
    for _, batch in bag.batches({DESCRIPTION}):
        description = robot_description(batch) or description
    kinds = {name: kind for name, kind in bag.topics.items() if kind in (JOINT_STATE, FLOAT_ARRAY)}
    names: dict[str, JointMessageReader] = {}
    numbers: dict[str, int] = {}
    counts: dict[str, tuple[int, int, int]] = {}  # messages, first and last arrival in ns
    for topic, batch in Bag(path).batches(set(kinds)):
        count, first, _ = counts.get(topic, (0, int(batch.arrival[0]), 0))
        counts[topic] = (count + len(batch), first, int(batch.arrival[-1]))
        if kinds[topic] == JOINT_STATE:
            names.setdefault(topic, JointMessageReader(topic, JOINT_STATE, [], [])).add(batch)
        elif topic not in numbers:
            layout = read_layout(batch.message(0), FLOAT_ARRAY)
            numbers[topic] = layout.fields["data"][1]
    joints = _joints(path, {topic: reader.finish().names for topic, reader in names.items()})
    topics = tuple(
        TopicContents(
            topic,
            count,
            (count - 1) / max(1e-9 * (last - first), 1e-9) if count > 1 else 0.0,
            joints.get(topic, {}),
            numbers.get(topic, 0),
        )
        for topic, (count, first, last) in counts.items()
    )
    unreadable = {name: kind for name, kind in bag.topics.items() if name not in kinds}
    unreadable.pop(DESCRIPTION, None)
    return BagContents(path, topics, unreadable, description)


def _joints(path: Path, names: dict[str, tuple[str, ...]]) -> dict[str, dict[str, JointContents]]:
    readers = {
        topic: JointMessageReader(topic, JOINT_STATE, each, ["position", "effort"])
        for topic, each in names.items()
    }
    for topic, batch in Bag(path).batches(set(readers)):
        readers[topic].add(batch)
    contents = {}
    for topic, reader in readers.items():
        values = reader.finish().values
        contents[topic] = {
            joint: _contents(values["position"][:, column], values["effort"][:, column])
            for column, joint in enumerate(names[topic])
        }
    return contents


def _contents(position: np.ndarray, effort: np.ndarray) -> JointContents:
    position, effort = position[np.isfinite(position)], effort[np.isfinite(effort)]
    return JointContents(
        float(position.min()) if len(position) else None,
        float(position.max()) if len(position) else None,
        float(np.abs(effort).max()) if len(effort) else None,
    )
