"""Which topic holds the joint states, which the efforts and which the reference."""

from collections.abc import Sequence
from dataclasses import dataclass

from idim_iv_ros.errors import DataError
from idim_iv_ros.first_configuration.topic_contents import BagContents, TopicContents
from idim_iv_ros.recording.other_topics import sounds_like_reference


@dataclass(frozen=True)
class TopicChoice:
    """The topics of a configuration, and why.

    Attributes
    ----------
    states : TopicContents
        Of the first bag.
    effort, reference : TopicContents or None
        Of the first bag; None where efforts are on `states`, and where there is no reference.
    reasons : dict of str to str
        By key of the section `signals`.
    """

    states: TopicContents
    effort: TopicContents | None
    reference: TopicContents | None
    reasons: dict[str, str]

    @property
    def efforts(self) -> TopicContents:
        """The topic with the efforts."""
        return self.effort or self.states


def choose_states(bags: Sequence[BagContents]) -> tuple[TopicContents, TopicContents | None]:
    """Choose the topic of the joint states, and that of the efforts where it is another.

    Raises
    ------
    DataError
        No bag has positions, or no effort that is not zero.
    """
    first = bags[0]
    states = [topic for topic in first.topics if topic.with_position()]
    if not states:
        held = ", ".join(f"{name} ({kind})" for name, kind in first.unreadable.items())
        raise DataError(
            f"{first.path}: no sensor_msgs/msg/JointState with positions; "
            f"it holds {held or 'nothing else'}; record /joint_states"
        )
    chosen = max(states, key=_likeness)
    if chosen.with_effort():
        return chosen, None
    others = [topic for topic in first.topics if topic.name != chosen.name]
    efforts = [topic for topic in others if topic.with_effort() & chosen.with_position()]
    efforts += [topic for topic in others if topic.numbers == len(chosen.joints)]
    if not efforts:
        zero = any(each.largest_effort is not None for each in chosen.joints.values())
        how = "is zero throughout" if zero else "is empty"
        raise DataError(
            f"{first.path}: effort on {chosen.name} {how} and no other topic holds any: nothing "
            "can be identified; let the driver publish motor currents or torques as effort"
        )
    return chosen, efforts[0]


def _likeness(topic: TopicContents) -> tuple[bool, int, int, bool, int]:
    """Measured joint states: not a reference, with efforts, of many joints."""
    return (
        not sounds_like_reference(topic.name),
        len(topic.with_effort() & topic.with_position()),
        len(topic.with_position()),
        topic.name.endswith("joint_states"),
        topic.messages,
    )


def choose_topics(bags: Sequence[BagContents], joints: Sequence[str]) -> TopicChoice:
    """Choose all topics for these joints."""
    states, effort = choose_states(bags)
    used = {states.name, effort.name if effort else ""}
    common = [topic for topic in bags[0].topics if _in_all(topic.name, bags, joints)]
    others = [topic for topic in common if topic.name not in used]
    references = [topic for topic in others if sounds_like_reference(topic.name)]
    reference = max(references, key=lambda topic: topic.messages, default=None)
    reasons = {"joint_states": _summary(states, bags[0])}
    if effort is not None:
        reasons["effort"] = f"{states.name} holds none; {_summary(effort, bags[0])}"
        if effort.numbers:
            reasons["effort"] += "; its numbers are taken in the order of robot.joints"
    if reference is not None:
        reasons["reference"] = _summary(reference, bags[0])
    elif others:
        names = ", ".join(topic.name for topic in others)
        reasons["reference"] = f"none of that name; {names}: positions too, if that is it"
    else:
        reasons["reference"] = "none in the bag: record it, it makes the instruments testable"
        controllers = [n for n, kind in bags[0].unreadable.items() if "ControllerState" in kind]
        if controllers:
            reasons["reference"] = (
                f"{controllers[0]} has it, but only sensor_msgs/msg/JointState is read"
            )
    return TopicChoice(states, effort, reference, reasons)


def _in_all(name: str, bags: Sequence[BagContents], joints: Sequence[str]) -> bool:
    """Whether every bag holds positions of all joints on the topic."""
    return all(
        any(topic.name == name and topic.with_position() >= set(joints) for topic in bag.topics)
        for bag in bags
    )


def _summary(topic: TopicContents, bag: BagContents) -> str:
    return f"{topic.messages} messages at {topic.rate:.4g} Hz in {bag.path.name}"
