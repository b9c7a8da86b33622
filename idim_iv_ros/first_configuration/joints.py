"""Which joints of the URDF are identified, and why the others are not."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from idim_iv_ros.errors import DataError
from idim_iv_ros.first_configuration.topics import BagContents, JointContents
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.model.urdf import MOVABLE, UrdfJoint
from idim_iv_ros.model.urdf_reader import read_urdf_text

_GRIPPER = re.compile(r"grip|finger|knuckle|jaw|thumb|palm", re.IGNORECASE)
_STILL = {"revolute": 0.02, "continuous": 0.02, "prismatic": 0.002}  # rad, rad, m
# A joint that is left out is locked at zero; this far away, it is not where it was.
_AWAY = 0.05  # rad or m


@dataclass(frozen=True)
class JointChoice:
    """Joints that a first configuration names, and those that it leaves out."""

    joints: tuple[str, ...]  # From the base to the tool
    # Movable joints of the URDF and joints of the bag that are left out, and why
    left_out: dict[str, str]
    warnings: tuple[str, ...]  # Joints that are left out although they matter


def choose_joints(
    urdf: str, source: str, bags: Sequence[BagContents], states: str, efforts: str | None
) -> JointChoice:
    """Choose the joints that move and have an effort in every bag.

    - `urdf`, `source`: text of the URDF, and what to call it
    - `states`, `efforts`: topics; `efforts` is None for a robot without

    Raises UsageError: not a URDF; see `read_urdf_text`; DataError: no joint is left.
    """
    robot = read_urdf_text(urdf, source)
    arrays = [topic.name for topic in bags[0].topics if topic.numbers]
    chosen, left_out, warnings = [], {}, []
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
    for topic in bags[0].topics:
        if topic.name == states and not topic.asked:
            left_out |= {
                name: "not in the URDF" for name in topic.joints if name not in robot.joints
            }
    if not chosen:
        why = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise DataError(
            f"{bags[0].path}: no joint of {source} can be identified ({why or 'it has none'})"
        )
    return JointChoice(tuple(chosen), left_out, tuple(warnings))


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
        unit = unit_at("rad", joint.type)
        return f"it stands still: it moves over {moved:.1g} {unit}"
    return ""


def _is_gripper(joint: UrdfJoint) -> bool:
    return _GRIPPER.search(joint.name) is not None
