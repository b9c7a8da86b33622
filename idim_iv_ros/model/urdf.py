"""Links and joints of a URDF as plain values, and whether they form a tree."""

from collections.abc import Iterator
from dataclasses import dataclass

import pinocchio as pin

from idim_iv_ros.errors import UsageError
from idim_iv_ros.types import FloatArray

MOVABLE = ("revolute", "continuous", "prismatic")
TYPES = (*MOVABLE, "fixed", "floating", "planar")
_MOST_PROBLEMS = 4


@dataclass(frozen=True)
class Inertial:
    """Mass and moments of one link, in the axes of the link's frame.

    Attributes
    ----------
    mass : float
        kg.
    centre : (3,) m
        Centre of mass in the link's frame.
    inertia : (3, 3) kg m²
        About the centre of mass.
    last_digit : float
        Value of the last digit with which the moments are written, kg m².
    """

    mass: float
    centre: FloatArray
    inertia: FloatArray
    last_digit: float


@dataclass(frozen=True)
class UrdfJoint:
    """One joint element.

    Attributes
    ----------
    name, type, parent, child : str
    placement : pinocchio.SE3
        Of the child's frame in the parent's, at position zero.
    axis : (3,)
        As it is written; (1, 0, 0) where it is not.
    limits : dict of str to float
        What `<limit>` gives of lower, upper (rad, m), velocity (rad/s, m/s), effort (N m, N).
    damping, friction : float
        N m s/rad, N m (N s/m, N).
    mimics : str
        The joint that it follows; empty where it follows none.
    """

    name: str
    type: str
    parent: str
    child: str
    placement: pin.SE3
    axis: FloatArray
    limits: dict[str, float]
    damping: float
    friction: float
    mimics: str


@dataclass(frozen=True)
class Urdf:
    """Links and joints of a URDF, which form one tree.

    Attributes
    ----------
    name : str
        Empty where the URDF gives none.
    root : str
        The link that is no joint's child.
    links : dict of str to Inertial or None
        In the order of the file.
    joints : dict of str to UrdfJoint
    """

    name: str
    root: str
    links: dict[str, Inertial | None]
    joints: dict[str, UrdfJoint]

    def outward(self) -> Iterator[tuple[str, UrdfJoint | None]]:
        """Each link with the joint that carries it, parents first, branches by joint name."""
        carried: dict[str, list[UrdfJoint]] = {}
        for each in sorted(self.joints.values(), key=lambda each: each.name, reverse=True):
            carried.setdefault(each.parent, []).append(each)
        waiting: list[tuple[str, UrdfJoint | None]] = [(self.root, None)]
        while waiting:
            link, joint = waiting.pop()
            yield link, joint
            waiting.extend((each.child, each) for each in carried.get(link, []))


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
    reached = set() if not bases else _reached(bases[0], joints)
    lost = [link for link in links if link not in reached]
    if lost:
        return "", [f"the joints form a loop through {_some(lost)}: a URDF is a tree"]
    return bases[0], []


def _some(names: list[str]) -> str:
    more = ", …" if len(names) > _MOST_PROBLEMS else ""
    return ", ".join(quoted(name) for name in names[:_MOST_PROBLEMS]) + more


def _reached(base: str, joints: dict[str, UrdfJoint]) -> set[str]:
    carried: dict[str, list[str]] = {}
    for joint in joints.values():
        carried.setdefault(joint.parent, []).append(joint.child)
    reached, waiting = {base}, [base]
    while waiting:
        children = carried.get(waiting.pop(), [])
        reached.update(children)
        waiting += children
    return reached
