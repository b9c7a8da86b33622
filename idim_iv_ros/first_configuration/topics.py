"""What the topics of a bag hold, and which are the joint states, the efforts and the reference."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.model.urdf import MOVABLE, UrdfJoint, read_urdf_text
from idim_iv_ros.recording.bags.folder import Bag
from idim_iv_ros.recording.bags.joint_message_type import (
    CONTROLLER_STATE,
    FLOAT_ARRAY,
    JOINT_STATE,
    MANY_STATES,
    JointMessageType,
    may_hold_joints,
)
from idim_iv_ros.recording.bags.joint_messages import JointMessageReader
from idim_iv_ros.recording.request import (
    ROBOT_DESCRIPTION,
    in_root,
    robot_description,
    sounds_like_reference,
)

_DESCRIPTION = in_root(ROBOT_DESCRIPTION)


@dataclass(frozen=True)
class JointContents:
    """What one JointState topic holds of one joint."""

    lowest: float | None  # Position, rad (m); None where it has none
    range: float  # Distance over which the joint moves, rad (m)
    # In the unit of the driver; None where it has none, 0 where all are zero
    largest_effort: float | None
    messages: int  # That hold a number of it


@dataclass(frozen=True)
class TopicContents:
    """A topic of a bag that can hold joint quantities, and what it holds."""

    name: str
    messages: int
    duration: float  # From the first message to the last, s
    joints: dict[str, JointContents]  # Empty for an array of numbers
    numbers: int = 0  # Length of an array of numbers; 0 for joint states
    kind: str = JOINT_STATE  # Message type
    # Whether `joints` are what a controller was asked for, by its type; its topic is listed a
    # second time with what was measured
    asked: bool = False

    def with_position(self) -> set[str]:
        """Names of joints of which the topic has positions."""
        return {name for name, joint in self.joints.items() if joint.lowest is not None}

    def with_effort(self) -> set[str]:
        """Names of joints of which the topic has an effort that is not zero."""
        return {name for name, joint in self.joints.items() if joint.largest_effort}


@dataclass(frozen=True)
class BagContents:
    """What a bag has for a first configuration: topics and a robot description."""

    path: Path
    topics: tuple[TopicContents, ...]
    unreadable: dict[str, str]  # Types of the other topics, by name
    # URDF on /robot_description, or on that of the only namespace that has one
    description: str | None

    def measured(self, topic: str, joint: str) -> JointContents | None:
        """What was measured of a joint on a topic."""
        topics = [one for one in self.topics if one.name == topic and not one.asked]
        return topics[0].joints.get(joint) if topics else None


def read_contents(path: Path) -> BagContents:
    """Look through a bag.

    Raises UsageError or DataError: no such bag, or not one.
    """
    bag = Bag(path)
    topics = bag.topic_types()
    described = {name for name in topics if name.endswith(_DESCRIPTION)}
    kinds = {name: kind for name, kind in topics.items() if may_hold_joints(kind)}
    descriptions: dict[str, str] = {}
    readers: dict[str, list[JointMessageReader]] = {}  # Of what was measured, and asked for
    numbers: dict[str, int] = {}
    counts: dict[str, tuple[int, int, int]] = {}  # messages, first and last arrival in ns
    for topic, batch in bag.batches({*kinds, *described}):
        if topic in described:
            text = robot_description(batch)
            descriptions.update({} if text is None else {topic: text})
            continue
        new, name = topic not in counts, bag.topics[topic]
        count, first, _ = counts.get(topic, (0, int(batch.arrival[0]), 0))
        counts[topic] = (count + len(batch), first, int(batch.arrival[-1]))
        if new and kinds[topic] == FLOAT_ARRAY:
            first_message = JointMessageType(FLOAT_ARRAY).read(batch.message(0), ["effort"])
            numbers[topic] = len(first_message.numbers.get("effort", ()))
        elif new:
            sides = (False, True) if kinds[topic] in (CONTROLLER_STATE, MANY_STATES) else (False,)
            types = [JointMessageType(name, bag.definitions.get(name), reference=s) for s in sides]
            fields = ["position", "effort"]
            readers[topic] = [JointMessageReader(topic, t, [], fields, grows=True) for t in types]
        for reader in readers.get(topic, ()):
            reader.add(batch)
    contents = []
    for topic, (count, first, last) in counts.items():
        duration, kind = 1e-9 * (last - first), kinds[topic]
        if topic in numbers:
            contents.append(TopicContents(topic, count, duration, {}, numbers[topic], kind))
        for side, reader in enumerate(readers.get(topic, ())):
            values = reader.finish().values
            columns = zip(reader.joints, values["position"].T, values["effort"].T, strict=True)
            joints = {name: _joint_contents(q, effort) for name, q, effort in columns}
            contents.append(TopicContents(topic, count, duration, joints, 0, kind, side == 1))
    readable = {*kinds, *described}
    unreadable = {name: kind for name, kind in topics.items() if name not in readable}
    # The global description, or that of the one namespace that has any.
    texts = set(descriptions.values())
    description = descriptions.get(_DESCRIPTION, texts.pop() if len(texts) == 1 else None)
    return BagContents(path, tuple(contents), unreadable, description)


def _joint_contents(position: np.ndarray, effort: np.ndarray) -> JointContents:
    """Sum up what messages (n,) hold of one joint; NaN where they hold nothing."""
    messages = int(np.count_nonzero(np.isfinite(position) | np.isfinite(effort)))
    position, effort = position[np.isfinite(position)], effort[np.isfinite(effort)]
    return JointContents(
        float(position.min()) if len(position) else None,
        float(np.ptp(position)) if len(position) else 0.0,
        float(np.abs(effort).max()) if len(effort) else None,
        messages,
    )


def choose_states(
    bags: Sequence[BagContents], wanted: str | None = None
) -> tuple[TopicContents, TopicContents | None]:
    """Choose the topic of the joint states, `wanted` if it holds any, and that of the efforts.

    The latter is None where it is the same, and where there are no efforts but something that was
    asked for: then the robot is one of servos.

    Raises DataError: no bag has positions, or neither an effort that is not zero nor a reference.
    """
    first = bags[0]
    states = [topic for topic in first.topics if topic.with_position() and not topic.asked]
    if not states:
        listed = ", ".join(f"{name} ({kind})" for name, kind in first.unreadable.items())
        raise DataError(
            f"{first.path}: no sensor_msgs/msg/JointState with positions; "
            f"it holds {listed or 'nothing else'}; record /joint_states"
        )
    chosen = max([state for state in states if state.name == wanted] or states, key=_likeness)
    if chosen.with_effort():
        return chosen, None
    others = [topic for topic in first.topics if topic.name != chosen.name and not topic.asked]
    efforts = [topic for topic in others if topic.with_effort() & chosen.with_position()]
    efforts += [topic for topic in others if topic.numbers == len(chosen.joints)]
    asked = [topic for topic in first.topics if topic.asked or sounds_like_reference(topic.name)]
    if not efforts and any(topic.with_position() & chosen.with_position() for topic in asked):
        return chosen, None
    if not efforts:
        zero = any(joint.largest_effort is not None for joint in chosen.joints.values())
        how = "is zero throughout" if zero else "is empty"
        raise DataError(
            f"{first.path}: effort on {chosen.name} {how} and no other topic holds any: nothing "
            "can be identified; let the driver publish motor currents or torques as effort, or "
            "record what the joints were asked for, from which servos are identified"
        )
    return chosen, efforts[0]


def _likeness(topic: TopicContents) -> tuple[bool, int, int, bool, bool, int]:
    """Measured joint states: not a reference, with efforts, of many joints."""
    return (
        not sounds_like_reference(topic.name),
        len(topic.with_effort() & topic.with_position()),
        len(topic.with_position()),
        topic.kind == JOINT_STATE,
        topic.name.endswith("joint_states"),
        topic.messages,
    )


def choose_topics(
    bags: Sequence[BagContents],
    joints: Sequence[str],
    states: TopicContents,
    effort: TopicContents | None,
) -> tuple[dict[str, str], dict[str, str]]:
    """Choose all topics for these joints; `states` and `effort` are those of `choose_states`.

    Returns topics, and the reasons for them or for their lack, by key of the section `signals`.
    """
    used = {states.name, effort.name if effort else ""}
    # Those on which every bag has positions of all joints.
    whole = [
        {(topic.name, topic.asked) for topic in bag.topics if topic.with_position() >= set(joints)}
        for bag in bags
    ]
    shared = set.intersection(*whole)
    common = [topic for topic in bags[0].topics if (topic.name, topic.asked) in shared]
    asked = [topic for topic in common if topic.asked]
    others = [t for t in common if t.kind == JOINT_STATE and t.name not in used]
    references = asked or [topic for topic in others if sounds_like_reference(topic.name)]
    reference = max(references, key=lambda topic: topic.messages, default=None)
    sources, reasons = {"joint_states": states.name}, {}
    reasons["joint_states"] = _summary(states, bags[0], joints)
    if effort is not None:
        sources["effort"] = effort.name
        reasons["effort"] = f"{states.name} holds none; {_summary(effort, bags[0], joints)}"
        if effort.numbers:
            reasons["effort"] += "; its numbers are taken in the order of robot.joints"
    if reference is not None:
        sources["reference"] = reference.name
        reasons["reference"] = _summary(reference, bags[0], joints)
        if reference.asked:
            reasons["reference"] += ", what the controller was asked for"
    elif others:
        names = ", ".join(topic.name for topic in others)
        reasons["reference"] = f"none of that name; {names}: positions too, if that is it"
    else:
        reasons["reference"] = "none in the bag: record it, it makes the instruments testable"
        for topic in (topic for topic in bags[0].topics if topic.asked):
            positioned = ", ".join(sorted(topic.with_position())) or "none"
            reasons["reference"] = (
                f"{topic.name} has what was asked of these joints only: {positioned}; the "
                "reference is read from one topic"
            )
    return sources, reasons


def _summary(topic: TopicContents, bag: BagContents, joints: Sequence[str]) -> str:
    """Count the messages of these joints: a gripper may publish there, too."""
    count = min([topic.joints[name].messages for name in joints if name in topic.joints] or [0])
    count = count or topic.messages
    rate = (count - 1) / max(topic.duration, 1e-9)
    return f"{count} messages at {rate:.4g} Hz in {bag.path.name}"


_GRIPPER = re.compile(r"grip|finger|knuckle|jaw|thumb|palm", re.IGNORECASE)
_STILL = {"revolute": 0.02, "continuous": 0.02, "prismatic": 0.002}  # rad, rad, m
# A joint that is left out is locked at zero; this far away, it is not where it was.
_AWAY = 0.05  # rad or m


def choose_joints(
    urdf: str, source: str, bags: Sequence[BagContents], states: str, efforts: str | None
) -> tuple[list[str], dict[str, str], tuple[str, ...]]:
    """Choose the joints that move and have an effort in every bag, from the base to the tool.

    - `urdf`, `source`: text of the URDF, and what to call it
    - `states`, `efforts`: topics; `efforts` is None for a robot without

    Returns with them the movable joints of the URDF and joints of the bag that are left out, and
    why, and warnings of those that are left out although they matter.

    Raises UsageError: not a URDF; see `read_urdf_text`; DataError: no joint is left.
    """
    robot = read_urdf_text(urdf, source)
    arrays = [topic.name for topic in bags[0].topics if topic.numbers]
    chosen: list[str] = []
    left_out, warnings = {}, []
    for _, joint in robot.outward():
        if joint is None or joint.type == "fixed":
            continue
        name = joint.name
        position = [bag.measured(states, name) for bag in bags]
        effort = [bag.measured(efforts or states, name) for bag in bags]
        reason = _why_not(joint, position, effort, efforts is None or efforts in arrays)
        if not reason:
            chosen.append(name)
            continue
        left_out[name] = reason
        lowest = position[0].lowest if position[0] is not None else None
        if lowest is not None and not _is_gripper(joint) and abs(lowest - joint.rest) > _AWAY:
            warnings.append(
                f"{name} is left out ({reason}) and the model locks it at {joint.rest:.3g}, but it "
                f"was at {lowest:.3g}: record a motion of it as well"
            )
    measured = [topic for topic in bags[0].topics if topic.name == states and not topic.asked]
    unknown = [name for topic in measured for name in topic.joints if name not in robot.joints]
    left_out |= dict.fromkeys(unknown, "not in the URDF")
    if not chosen:
        why = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise DataError(
            f"{bags[0].path}: no joint of {source} can be identified ({why or 'it has none'})"
        )
    return chosen, left_out, tuple(warnings)


def _why_not(
    joint: UrdfJoint,
    position: Sequence[JointContents | None],
    effort: Sequence[JointContents | None],
    needless: bool,
) -> str:
    """Reason to leave a movable joint out; empty where it is identified."""
    if joint.type not in MOVABLE:
        return f"its type is {joint.type}"
    if joint.tied or joint.beyond:
        return f"it is {joint.tied}" if joint.tied else f"it has {joint.beyond}"
    if _is_gripper(joint):
        return "a gripper, by its name; if it is a joint of the arm, name it in robot.joints"
    if any(seen is None or seen.lowest is None for seen in position):
        return "not in the bag"
    if not needless and not all(seen is not None and seen.largest_effort for seen in effort):
        return "its effort is empty or zero"
    moved = max(seen.range for seen in position if seen is not None)
    if moved < _STILL[joint.type]:
        return f"it stands still: it moves over {moved:.1g} {unit_at('rad', joint.type)}"
    return ""


def _is_gripper(joint: UrdfJoint) -> bool:
    return _GRIPPER.search(joint.name) is not None
