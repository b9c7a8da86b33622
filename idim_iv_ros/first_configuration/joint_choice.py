"""Which joints of the URDF are identified, and why the others are not."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.first_configuration.topic_contents import BagContents, JointContents

_MOVABLE = ("revolute", "continuous", "prismatic")
_GRIPPER = re.compile(r"grip|finger|knuckle|jaw|thumb|palm", re.IGNORECASE)
_STILL = {"revolute": 0.02, "continuous": 0.02, "prismatic": 0.002}  # rad, rad, m
# A joint that is left out is locked at zero; standing this far away, it is not where it was.
_AWAY = 0.05  # rad or m


@dataclass(frozen=True)
class JointChoice:
    """The joints of a configuration.

    Attributes
    ----------
    joints : tuple of str
        From the base to the tool.
    left_out : dict of str to str
        Movable joints of the URDF and joints of the bag that are left out, and why.
    warnings : tuple of str
        Joints that are left out although they matter.
    """

    joints: tuple[str, ...]
    left_out: dict[str, str]
    warnings: tuple[str, ...]


def choose_joints(
    urdf: str, source: str, bags: Sequence[BagContents], states: str, efforts: str
) -> JointChoice:
    """Choose the joints that move and have an effort in every bag.

    Parameters
    ----------
    urdf, source
        Text of the URDF, and what to call it.
    states, efforts
        Topics.

    Raises
    ------
    UsageError
        Not a URDF.
    DataError
        No joint is left.
    """
    elements = _from_base_to_tool(urdf, source)
    chosen, left_out, warnings = [], {}, []
    for joint in elements:
        name, kind = joint.get("name", ""), joint.get("type", "")
        if kind == "fixed":
            continue
        position = [_contents(bag, states, name) for bag in bags]
        effort = [_contents(bag, efforts, name) for bag in bags]
        reason = _why_not(joint, position, effort, _is_array(bags[0], efforts))
        if not reason:
            chosen.append(name)
            continue
        left_out[name] = reason
        lowest = position[0].lowest if position[0] is not None else None
        if lowest is not None and not _is_gripper(joint) and abs(lowest) > _AWAY:
            warnings.append(
                f"{name} is left out ({reason}) and the model locks it at zero, but it was at "
                f"{lowest:.3g}: record a motion of it as well"
            )
    known = {element.get("name") for element in elements}
    recorded = [name for topic in bags[0].topics if topic.name == states for name in topic.joints]
    left_out.update({name: "not in the URDF" for name in recorded if name not in known})
    if not chosen:
        why = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise DataError(
            f"{bags[0].path}: no joint of {source} can be identified ({why or 'it has none'})"
        )
    return JointChoice(tuple(chosen), left_out, tuple(warnings))


def _why_not(
    joint: ElementTree.Element,
    position: Sequence[JointContents | None],
    effort: Sequence[JointContents | None],
    array: bool,
) -> str:
    """Reason to leave a movable joint out; empty where it is identified."""
    kind, mimic = joint.get("type", ""), joint.find("mimic")
    if kind not in _MOVABLE:
        return f"its type is {kind}"
    if mimic is not None:
        return f"it mimics {mimic.get('joint')}"
    if _is_gripper(joint):
        return "a gripper, by its name"
    if any(each is None or each.lowest is None for each in position):
        return "not in the bag"
    if not array and not all(each is not None and each.largest_effort for each in effort):
        return "its effort is empty or zero"
    moved = max(each.range for each in position if each is not None)
    if moved < _STILL[kind]:
        return f"it stands still: it moves over {moved:.1g} {'m' if kind == 'prismatic' else 'rad'}"
    return ""


def _is_gripper(joint: ElementTree.Element) -> bool:
    return _GRIPPER.search(joint.get("name", "")) is not None


def _is_array(bag: BagContents, name: str) -> bool:
    return any(topic.name == name and topic.numbers for topic in bag.topics)


def _contents(bag: BagContents, name: str, joint: str) -> JointContents | None:
    for topic in bag.topics:
        if topic.name == name:
            return topic.joints.get(joint)
    return None


def _from_base_to_tool(urdf: str, source: str) -> list[ElementTree.Element]:
    """Joints of a URDF, each after the one that carries it."""
    try:
        root = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise UsageError(f"{source}: not XML: {error}") from error
    if root.tag != "robot":
        raise UsageError(f"{source}: not a URDF: the root element is <{root.tag}>, not <robot>")
    joints = root.findall("joint")
    below: dict[str, list[ElementTree.Element]] = {}
    for joint in joints:
        below.setdefault(_link(joint, "parent"), []).append(joint)
    moved = {_link(joint, "child") for joint in joints}
    waiting = [joint for joint in joints if _link(joint, "parent") not in moved][::-1]
    ordered: list[ElementTree.Element] = []
    while waiting and len(ordered) < len(joints):
        joint = waiting.pop()
        ordered.append(joint)
        waiting += below.get(_link(joint, "child"), [])[::-1]
    return ordered


def _link(joint: ElementTree.Element, which: str) -> str:
    element = joint.find(which)
    return "" if element is None else element.get("link", "")
