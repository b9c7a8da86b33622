"""Links and joints of a URDF as plain values: whether they form a tree, and what no body can be.

A body has a mass of at least zero and a density that is nowhere negative. Then no principal
moment is negative, and none is larger than the sum of the other two (Featherstone, Rigid Body
Dynamics Algorithms, section 2.11). What breaks this is refused beyond two tolerances:

- the rounding of the digits that the file gives (a planar part of 0.25, 0.149 and 0.101 kg m²
  is written as 0.3, 0.1, 0.1), up to a tenth of the trace: a larger one says nothing;
- a hundredth of the trace, or 1e-6 kg m², less than any drive's inertia: fitted and rounded
  tables that drive real robots are that far off, and the torque hardly changes.

What is within them, and what is possible but strange, is a doubt that the user is shown.

The project reads URDF itself: urdfdom prints its complaints on the terminal and goes on with half
a robot, and pinocchio looks links and joints up by one name, although a link and a joint may
share theirs.
"""

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError, first_of
from idim_iv_ros.files import read_text
from idim_iv_ros.model.mjcf import EXTENSION, is_mjcf, mjcf_as_urdf
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
    damping: float  # N m s/rad (N s/m)
    friction: float  # N m (N)
    armature: float = 0.0  # Of an MJCF: drive inertia, kg m² (kg)
    rest: float = 0.0  # Of an MJCF: where it stays if it is not identified, rad (m)
    tied: str = ""  # What it is or what ties it, if it is no joint by itself
    beyond: str = ""  # Of an MJCF: what acts on it that the nominal model has no term for


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
    verdicts = [
        (f"link {quoted(name)}", _judge_inertial(inertial, max(length, _NEAR)))
        for name, inertial in urdf.links.items()
        if inertial is not None
    ]
    for name in identified:
        joint = urdf.joints.get(name)
        if joint is not None and joint.type in MOVABLE:
            verdicts.append((f"joint {quoted(name)}", _judge_joint(joint)))
    for what, (wrong, strange) in verdicts:
        impossible += [f"{what}: {text}" for text in wrong]
        doubts += [f"{what}: {text}" for text in strange]
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


def _judge_joint(joint: UrdfJoint) -> tuple[list[str], list[str]]:
    wrong, limits, turns_on = [], joint.limits, joint.type == "continuous"
    if float(np.linalg.norm(joint.axis)) < 1e-9:
        wrong.append("its axis is zero")
    angle, torque = unit_at("rad", joint.type), unit_at("N m", joint.type)
    lower, upper = limits.get("lower", 0.0), limits.get("upper", 0.0)
    if not turns_on and lower > upper:
        wrong.append(f"lower limit {lower:g} is above upper limit {upper:g} {angle}")
    for key, unit in (("velocity", f"{angle}/s"), ("effort", torque)):
        if limits.get(key, 0.0) < 0.0:
            wrong.append(f"{key} limit {limits[key]:g} {unit} is negative")
    for key, value in (("damping", joint.damping), ("friction", joint.friction)):
        if value < 0.0:
            wrong.append(f"{key} {value:g} is negative: friction takes energy out")
    if not limits:
        return wrong, [] if turns_on else ["no <limit>: taken as unlimited"]
    zero = [] if turns_on or lower != upper else ["position"]
    zero += [key for key in ("velocity", "effort") if limits.get(key) == 0.0]
    return wrong, [f"{' and '.join(zero)} limit of zero: taken as none"] if zero else []


# URDF files write right angles with few digits (1.5708); within this they are taken as meant.
RIGHT_ANGLE_TOLERANCE = 1e-5
# An angle that is written with more characters is none that was rounded to a few digits.
_EXACT_ANGLE = 20
# No length, mass or moment of a robot is larger in SI units; products of larger ones overflow.
LARGEST = 1e9
_LARGEST_FILE = 50.0  # MB
_T = TypeVar("_T")
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def read_urdf_file(path: Path) -> str:
    """Return the text of a URDF file, in UTF-8 or in the encoding that its first line declares.

    Of an MJCF file that of a URDF with the same bodies and joints (`mjcf_as_urdf`).

    Raises UsageError: the file cannot be read, is no text, or is an MJCF that MuJoCo cannot read.
    """
    text = _description(path)
    return mjcf_as_urdf(path) if is_mjcf(text) else text


def description_key(path: Path) -> str:
    """Key of the configuration under which a file that can be read is named: urdf or mjcf."""
    return "mjcf" if is_mjcf(_description(path)) else "urdf"


def _description(path: Path) -> str:
    return read_text(path, "the URDF", megabytes=_LARGEST_FILE, decode=decoded_urdf)


def decoded_urdf(content: bytes) -> str:
    """Text of the bytes of a URDF: UTF-8, or the encoding that its first line declares."""
    declared = re.match(rb"<\?xml[^>]*encoding=[\"']([\w.-]+)[\"']", content)
    return content.decode(declared.group(1).decode() if declared else "utf-8-sig")


def read_urdf_text(urdf: str, source: str) -> Urdf:
    """Read a URDF; geometry, meshes, transmissions and extensions are passed over.

    Raises UsageError: not XML, not a URDF, numbers that are none, or links and joints that form no
    tree. All problems are listed in one line.
    """
    # Entities can make a short text fill the memory, and no URDF needs them.
    if "<!ENTITY" in urdf:
        raise UsageError(f"{source}: declares XML entities, which a URDF does not have")
    if not urdf.strip():
        raise UsageError(f"{source}: is empty, not a URDF")
    try:
        root = ElementTree.fromstring(urdf)
    except (ElementTree.ParseError, ValueError) as error:
        raise UsageError(f"{source}: not XML: {error}") from error
    if root.tag != "robot":
        raise UsageError(
            f"{source}: not a URDF: the root element is <{quoted(root.tag)}>, not <robot>"
        )
    reader = _Reader([])
    links = reader.named(root, "link", reader.link)
    joints = reader.named(root, "joint", reader.joint)
    refuse(source, reader.problems)
    base, problems = base_link(links, joints)
    refuse(source, problems)
    extension = root.find(EXTENSION)
    notes = [] if extension is None else extension.findall("note")
    sentences = tuple(note.text or "" for note in notes)
    return Urdf(root.get("name", ""), base, links, joints, extension is not None, sentences)


@dataclass(frozen=True)
class _Reader:
    """Values of elements; what is wrong with them is gathered in `problems`."""

    problems: list[str]

    def named(self, root: Element, tag: str, read: Callable[[Element, str], _T]) -> dict[str, _T]:
        values: dict[str, _T] = {}
        for element in root.findall(tag):
            name = element.get("name", "")
            if not name:
                self.problems.append(f"a <{tag}> has no name")
            elif name in values:
                self.problems.append(f"two {tag}s are named {quoted(name)}")
            values[name] = read(element, name)
        return values

    def link(self, element: Element, name: str) -> Inertial | None:
        where = f"link {name}"
        inertial = self._only(element, "inertial", where)
        if inertial is None:
            return None
        mass, inertia = (self._only(inertial, tag, where) for tag in ("mass", "inertia"))
        for tag, child in (("mass", mass), ("inertia", inertia)):
            if child is None:
                self.problems.append(f"{where}: <inertial> has no <{tag}>")
        if mass is None or inertia is None:
            return None
        placement = self._origin(inertial, f"{where}: <inertial>")
        moments, rotation = np.zeros((3, 3)), placement.rotation
        for key in _MOMENTS:
            row, column = ("xyz".index(axis) for axis in key[1:])
            moments[row, column] = self._number(inertia, key, f"{where}: <inertia>")
            moments[column, row] = moments[row, column]
        return Inertial(
            mass=self._number(mass, "value", f"{where}: <mass>"),
            centre=placement.translation,
            inertia=rotation @ moments @ rotation.T,
            last_digit=_last_digit([inertia.get(key, "") for key in _MOMENTS]),
        )

    def joint(self, element: Element, name: str) -> UrdfJoint:
        where = f"joint {quoted(name)}"
        joint_type = element.get("type", "")
        if joint_type not in TYPES:
            words = f"unknown type {quoted(joint_type)}" if joint_type else "no type"
            self.problems.append(f"{where}: {words}; a joint is {', '.join(TYPES)}")
        ends = {}
        for tag in ("parent", "child"):
            end = self._only(element, tag, where)
            ends[tag] = "" if end is None else end.get("link", "")
            if not ends[tag]:
                self.problems.append(f"{where}: names no {tag} link")
        axis, dynamics = (self._only(element, tag, where) for tag in ("axis", "dynamics"))
        limit, place = self._only(element, "limit", where), self._origin(element, where)
        limits: dict[str, float] = {}
        for key in ("lower", "upper", "velocity", "effort"):
            if limit is not None and key in limit.attrib:
                limits[key] = self._number(limit, key, f"{where}: <limit>", largest=math.inf)
        damping = friction = 0.0
        if dynamics is not None:
            damping = self._number(dynamics, "damping", f"{where}: <dynamics>", "0")
            friction = self._number(dynamics, "friction", f"{where}: <dynamics>", "0")
        # What an MJCF says of a joint and a URDF does not.
        beyond: dict[str, Any] = {}
        extension, mimic = element.find(EXTENSION), element.find("mimic")
        if extension is not None:
            beyond = {key: self._number(extension, key, where, "0") for key in ("armature", "rest")}
            beyond |= {key: extension.get(key, "") for key in ("tied", "beyond")}
        elif mimic is not None:
            beyond["tied"] = f"made to follow {quoted(mimic.get('joint', 'another'))} by <mimic>"
        return UrdfJoint(
            name=name,
            type=joint_type,
            parent=ends["parent"],
            child=ends["child"],
            placement=place,
            axis=np.array([1.0, 0.0, 0.0])
            if axis is None
            else self._vector(axis, "xyz", f"{where}: <axis>", "1 0 0"),
            limits=limits,
            damping=damping,
            friction=friction,
            **beyond,
        )

    def _only(self, element: Element, tag: str, where: str) -> Element | None:
        """The one child of a tag; others would be passed over, and nobody knows which is meant."""
        children = element.findall(tag)
        if len(children) > 1:
            self.problems.append(f"{where} has {len(children)} <{tag}>: leave one")
        return children[0] if children else None

    def _origin(self, element: Element, where: str) -> pin.SE3:
        origin = self._only(element, "origin", where)
        if origin is None:
            return pin.SE3.Identity()
        translation = self._vector(origin, "xyz", f"{where} <origin>", "0 0 0")
        angles = self._vector(origin, "rpy", f"{where} <origin>", "0 0 0")
        for k, word in enumerate(origin.get("rpy", "0 0 0").split()[:3]):
            right = round(angles[k] / (math.pi / 2)) * (math.pi / 2)
            if len(word) <= _EXACT_ANGLE and abs(angles[k] - right) < RIGHT_ANGLE_TOLERANCE:
                angles[k] = right
        return pin.SE3(pin.rpy.rpyToMatrix(*angles), translation)

    def _vector(self, element: Element, key: str, where: str, default: str) -> FloatArray:
        words = element.get(key, default).split()
        if len(words) != 3:
            self.problems.append(f"{where}: {key} has {len(words)} numbers, not 3")
            return np.zeros(3)
        return np.array([self._value(word, f"{where}: {key}", LARGEST) for word in words])

    def _number(
        self,
        element: Element,
        key: str,
        where: str,
        default: str | None = None,
        largest: float = LARGEST,
    ) -> float:
        text = element.get(key, default)
        if text is None:
            self.problems.append(f"{where} has no {key}")
            return 0.0
        return self._value(text, f"{where} {key}", largest)

    def _value(self, text: str, where: str, largest: float) -> float:
        try:
            value = float(text)
        except ValueError:
            hint = "; expand the xacro first" if "${" in text else ""
            self.problems.append(f"{where} is {quoted(text) or 'empty'}, not a number{hint}")
            return 0.0
        if not abs(value) <= largest:  # NaN too
            self.problems.append(f"{where} is {quoted(text)}, which no robot has")
            return 0.0
        return value


def _last_digit(texts: list[str]) -> float:
    """Value of the last digit of the numbers that are not zero: of the finest of them.

    Trailing zeros are often left out, so that one number alone does not show its digits.
    """
    finest = []
    for text in texts:
        try:
            number = Decimal(text.strip())
        except ArithmeticError:
            continue
        exponent = number.as_tuple().exponent
        if number and isinstance(exponent, int):
            finest.append(exponent)
    return float(Decimal(1).scaleb(min(finest))) if finest else 0.0
