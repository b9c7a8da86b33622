"""From the text of a URDF to plain values, with every number and name checked.

The project reads URDF itself: urdfdom prints its complaints on the terminal and goes on with half
a robot, and pinocchio looks links and joints up by one name, although a link and a joint may
share theirs.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import read_text
from idim_iv_ros.model.mjcf import EXTENSION, is_mjcf, mjcf_as_urdf
from idim_iv_ros.model.urdf import TYPES, Inertial, Urdf, UrdfJoint, base_link, quoted, refuse
from idim_iv_ros.types import FloatArray

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
            numbers = ("armature", "rest")
            beyond = {key: self._number(extension, key, where, "0") for key in numbers}
            beyond |= {key: extension.get(key, "") for key in ("tied", "beyond")}
        elif mimic is not None:
            followed = quoted(mimic.get("joint", "another"))
            beyond["tied"] = f"made to follow {followed} by <mimic>"
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
