"""Links and joints of a URDF as plain values: whether they form a tree, and what no body can be.

A body has a mass of at least zero and a density that is nowhere negative. Then no principal
moment is negative, and none is larger than the sum of the other two (Featherstone, Rigid Body
Dynamics Algorithms, section 2.11). What breaks this is refused beyond two tolerances:

- the rounding of the digits that the file gives (a planar part of 0.25, 0.149 and 0.101 kg m²
  is written as 0.3, 0.1, 0.1), up to a tenth of the trace: a larger one says nothing;
- a hundredth of the trace, or 1e-6 kg m², less than any drive's inertia: fitted and rounded
  tables that drive real robots are that far off, and the torque hardly changes.

What is within them, and what is possible but strange, is a doubt that the user is shown.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError, first_of
from idim_iv_ros.model.parameters import unit_at
from idim_iv_ros.types import FloatArray

MOVABLE = ("revolute", "continuous", "prismatic")
TYPES = (*MOVABLE, "fixed", "floating", "planar")
_MOST_PROBLEMS = 4

_OF_TRACE, _LARGEST_OF_TRACE = 0.01, 0.1
_SMALL_MOMENT = 1e-6  # kg m²
_ROUNDED = 1.5  # last digits: three moments, half a digit each
_EXACT = 1e-9  # of the trace: rounding of the computer
_HEAVY = 1e4  # kg
_NEAR = 1.0  # m: within this of its joint any centre of mass is believed


@dataclass(frozen=True)
class Inertial:
    """Mass and moments of one link, in the axes of the link's frame."""

    mass: float  # kg
    centre: FloatArray  # (3,) m: centre of mass in the link's frame
    inertia: FloatArray  # (3, 3) kg m²: about the centre of mass
    last_digit: float  # Value of the last digit with which the moments are written, kg m²


@dataclass(frozen=True)
class UrdfJoint:
    """A joint element of a URDF."""

    name: str
    type: str
    parent: str
    child: str
    placement: pin.SE3  # pinocchio.SE3: of the child's frame in the parent's, at position zero
    axis: FloatArray  # (3,): as it is written; (1, 0, 0) where it is not
    # What `<limit>` gives of lower, upper (rad, m), velocity (rad/s, m/s), effort (N m, N)
    limits: dict[str, float]
    # damping, friction: N m s/rad, N m (N s/m, N)
    damping: float
    friction: float
    # armature, rest: Of an MJCF: drive inertia, kg m² (kg); where it stays if it is not identified,
    # rad (m)
    armature: float = 0.0
    rest: float = 0.0
    # tied, beyond: What it is or what ties it, if it is no joint of its own; what acts on it that
    # the nominal model has no term for, of an MJCF. Empty otherwise.
    tied: str = ""
    beyond: str = ""


@dataclass(frozen=True)
class Urdf:
    """Links and joints of a URDF, which form one tree."""

    name: str  # Empty where the URDF gives none
    root: str  # The link that is no joint's child
    links: dict[str, Inertial | None]  # In the order of the file
    joints: dict[str, UrdfJoint]
    from_mjcf: bool = False  # Whether it was an MJCF, which gives the armature of every joint
    notes: tuple[str, ...] = ()  # What the nominal model passes over, a sentence each

    def outward(self) -> Iterator[tuple[str, UrdfJoint | None]]:
        """Each link with the joint that carries it, parents first, branches by joint name."""
        carried: dict[str, list[UrdfJoint]] = {}
        for name in sorted(self.joints, reverse=True):
            carried.setdefault(self.joints[name].parent, []).append(self.joints[name])
        waiting: list[tuple[str, UrdfJoint | None]] = [(self.root, None)]
        while waiting:
            link, joint = waiting.pop()
            yield link, joint
            waiting.extend((body.child, body) for body in carried.get(link, []))


def refuse(source: str, problems: list[str]) -> None:
    """Raise a `UsageError` that lists the problems of a URDF; nothing where there are none."""
    if not problems:
        return
    more = len(problems) - _MOST_PROBLEMS
    listed = "; ".join(problems[:_MOST_PROBLEMS])
    raise UsageError(f"{source}: {listed}" + (f"; and {more} more" if more > 0 else ""))


def quoted(text: str) -> str:
    """Shorten text of a file so that it fits a message."""
    text = " ".join(text.split())
    return text if len(text) <= 60 else f"{text[:40]}…{text[-15:]}"


def base_link(
    links: dict[str, Inertial | None], joints: dict[str, UrdfJoint]
) -> tuple[str, list[str]]:
    """Return the link that carries all others, and what prevents a tree."""
    if not links:
        return "", ["has no <link>"]
    problems = []
    carrier: dict[str, str] = {}
    for joint in joints.values():
        for what, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                problems.append(
                    f"joint {quoted(joint.name)}: its {what} link {quoted(link)} is not in the file"
                )
        if joint.child in carrier:
            problems.append(
                f"link {quoted(joint.child)} is the child of two joints, "
                f"{quoted(carrier[joint.child])} and {quoted(joint.name)}"
            )
        carrier[joint.child] = joint.name
    bases = [link for link in links if link not in carrier]
    if problems:
        return "", problems
    if len(bases) > 1:
        names = _some(bases)
        return "", [f"{len(bases)} links are no joint's child ({names}): a URDF has one base link"]
    tree = Urdf("", bases[0], links, joints).outward() if bases else ()
    reached = {link for link, _ in tree}
    lost = [link for link in links if link not in reached]
    if lost:
        return "", [f"the joints form a loop through {_some(lost)}: a URDF is a tree"]
    return bases[0], []


def _some(names: list[str]) -> str:
    return first_of([quoted(name) for name in names], _MOST_PROBLEMS)


def judge_urdf(urdf: Urdf, identified: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return what is impossible and what is implausible, one sentence each.

    - `identified`: joints that move; of the others the axis and the limits do not matter
    """
    impossible: list[str] = []
    doubts: list[str] = []
    length = sum(float(np.linalg.norm(j.placement.translation)) for j in urdf.joints.values())
    for name, inertial in urdf.links.items():
        if inertial is not None:
            wrong, strange = _judge_inertial(inertial, max(length, _NEAR))
            impossible += [f"link {quoted(name)}: {text}" for text in wrong]
            doubts += [f"link {quoted(name)}: {text}" for text in strange]
    for name in identified:
        joint = urdf.joints.get(name)
        if joint is not None and joint.type in MOVABLE:
            impossible += [f"joint {quoted(name)}: {text}" for text in _wrong_joint(joint)]
            doubts += [f"joint {quoted(name)}: {text}" for text in _strange_limits(joint)]
    return impossible, doubts


def _judge_inertial(inertial: Inertial, far: float) -> tuple[list[str], list[str]]:
    """What no body has, and what is strange for a robot of the size `far`, m."""
    mass = inertial.mass
    if mass < 0.0:
        return [f"mass {mass:g} kg is negative"], []
    least, middle, largest = (float(value) for value in np.linalg.eigvalsh(inertial.inertia))
    trace = least + middle + largest
    missing = largest - middle - least
    size = max(abs(least), abs(largest))
    rounding = min(_ROUNDED * inertial.last_digit, _LARGEST_OF_TRACE * size)
    tolerance = max(_OF_TRACE * size, rounding, _SMALL_MOMENT)
    moments = f"principal moments {least:.3g}, {middle:.3g}, {largest:.3g} kg m²"
    rule = (
        "one is negative"
        if least < -_EXACT * size
        else "the largest exceeds the sum of the others (triangle inequality)"
    )
    if missing > tolerance:
        return [f"{moments}: {rule}; no body has that"], []
    doubts = []
    if missing > _EXACT * size:
        doubts.append(f"{moments}: {rule}, by no more than rounding may do")
    if mass == 0.0 and size > 0.0:
        doubts.append(f"moments of inertia up to {largest:.3g} kg m² without a mass")
    elif mass > 0.0 and math.sqrt(0.5 * max(trace, 0.0) / mass) > far:
        doubts.append(
            f"a moment of inertia of {largest:.3g} kg m² with {mass:g} kg: a radius of gyration of "
            f"{math.sqrt(0.5 * trace / mass):.3g} m on a robot of {far:.3g} m"
        )
    distance = float(np.linalg.norm(inertial.centre))
    if distance > far and mass > 0.0:
        doubts.append(f"centre of mass {distance:.3g} m from its joint on a robot of {far:.3g} m")
    if mass > _HEAVY:
        doubts.append(f"a mass of {mass:g} kg")
    return [], doubts


def _wrong_joint(joint: UrdfJoint) -> list[str]:
    wrong = []
    if float(np.linalg.norm(joint.axis)) < 1e-9:
        wrong.append("its axis is zero")
    angle, torque = unit_at("rad", joint.type), unit_at("N m", joint.type)
    lower, upper = joint.limits.get("lower", 0.0), joint.limits.get("upper", 0.0)
    if joint.type != "continuous" and lower > upper:
        wrong.append(f"lower limit {lower:g} is above upper limit {upper:g} {angle}")
    for key, unit in (("velocity", f"{angle}/s"), ("effort", torque)):
        if joint.limits.get(key, 0.0) < 0.0:
            wrong.append(f"{key} limit {joint.limits[key]:g} {unit} is negative")
    for key, value in (("damping", joint.damping), ("friction", joint.friction)):
        if value < 0.0:
            wrong.append(f"{key} {value:g} is negative: friction takes energy out")
    return wrong


def _strange_limits(joint: UrdfJoint) -> list[str]:
    limits = joint.limits
    if not limits:
        return [] if joint.type == "continuous" else ["no <limit>: taken as unlimited"]
    zero = [key for key in ("velocity", "effort") if limits.get(key) == 0.0]
    if joint.type != "continuous" and limits.get("lower", 0.0) == limits.get("upper", 0.0):
        zero.insert(0, "position")
    return [f"{' and '.join(zero)} limit of zero: taken as none"] if zero else []
