"""From the text of a URDF to plain values, with every number and name checked.

The project reads URDF itself: urdfdom prints its complaints on the terminal and goes on with half
a robot, and pinocchio looks links and joints up by one name, although a link and a joint may
share theirs.
"""

import math
import re
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

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
    root = _element_tree(urdf, source)
    reader = _Reader()
    links = reader.links(root)
    joints = reader.joints(root)
    refuse(source, reader.problems)
    base, problems = base_link(links, joints)
    refuse(source, problems)
    extension = root.find(EXTENSION)
    notes = [] if extension is None else extension.findall("note")
    sentences = tuple(note.text or "" for note in notes)
    return Urdf(root.get("name", ""), base, links, joints, extension is not None, sentences)


def _element_tree(urdf: str, source: str) -> ElementTree.Element:
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
    return root


class _Reader:
    """Values of elements; what is wrong with them is gathered in `problems`."""

    def __init__(self) -> None:
        self.problems: list[str] = []

    def links(self, root: ElementTree.Element) -> dict[str, Inertial | None]:
        links: dict[str, Inertial | None] = {}
        for element in root.findall("link"):
            name = self._name(element, links)
            inertial = self._only(element, "inertial", f"link {name}")
            links[name] = None if inertial is None else self._inertial(inertial, f"link {name}")
        return links

    def joints(self, root: ElementTree.Element) -> dict[str, UrdfJoint]:
        joints: dict[str, UrdfJoint] = {}
        for element in root.findall("joint"):
            name = self._name(element, joints)
            joints[name] = self._joint(element, name)
        return joints

    def _name(self, element: ElementTree.Element, taken: Mapping[str, object]) -> str:
        name = element.get("name", "")
        if not name:
            self.problems.append(f"a <{element.tag}> has no name")
        elif name in taken:
            self.problems.append(f"two {element.tag}s are named {quoted(name)}")
        return name

    def _inertial(self, element: ElementTree.Element, where: str) -> Inertial | None:
        mass, inertia = (self._only(element, tag, where) for tag in ("mass", "inertia"))
        for tag, child in (("mass", mass), ("inertia", inertia)):
            if child is None:
                self.problems.append(f"{where}: <inertial> has no <{tag}>")
        if mass is None or inertia is None:
            return None
        placement = self._origin(element, f"{where}: <inertial>")
        xx, yy, zz, xy, xz, yz = (
            self._number(inertia, key, f"{where}: <inertia>") for key in _MOMENTS
        )
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        rotation = placement.rotation
        return Inertial(
            mass=self._number(mass, "value", f"{where}: <mass>"),
            centre=placement.translation,
            inertia=rotation @ moments @ rotation.T,
            last_digit=_last_digit([inertia.get(key, "") for key in _MOMENTS]),
        )

    def _joint(self, element: ElementTree.Element, name: str) -> UrdfJoint:
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
        return UrdfJoint(
            name=name,
            type=joint_type,
            parent=ends["parent"],
            child=ends["child"],
            placement=self._origin(element, where),
            axis=np.array([1.0, 0.0, 0.0])
            if axis is None
            else self._vector(axis, "xyz", f"{where}: <axis>", "1 0 0"),
            limits=self._limits(element, where),
            damping=self._dynamics(dynamics, "damping", where),
            friction=self._dynamics(dynamics, "friction", where),
            **self._beyond(element, where),
        )

    def _only(
        self, element: ElementTree.Element, tag: str, where: str
    ) -> ElementTree.Element | None:
        """The one child of a tag; others would be passed over, and nobody knows which is meant."""
        children = element.findall(tag)
        if len(children) > 1:
            self.problems.append(f"{where} has {len(children)} <{tag}>: leave one")
        return children[0] if children else None

    def _beyond(self, element: ElementTree.Element, where: str) -> dict[str, Any]:
        """What ties a joint, and what an MJCF says of it and a URDF does not."""
        extension, mimic = element.find(EXTENSION), element.find("mimic")
        if extension is None:
            if mimic is None:
                return {}
            return {"tied": f"made to follow {quoted(mimic.get('joint', 'another'))} by <mimic>"}
        numbers = {key: self._number(extension, key, where, "0") for key in ("armature", "rest")}
        words = {key: extension.get(key, "") for key in ("tied", "beyond")}
        return {**numbers, **words}

    def _limits(self, element: ElementTree.Element, where: str) -> dict[str, float]:
        limit = self._only(element, "limit", where)
        if limit is None:
            return {}
        keys = [key for key in ("lower", "upper", "velocity", "effort") if key in limit.attrib]
        return {
            key: self._number(limit, key, f"{where}: <limit>", largest=math.inf) for key in keys
        }

    def _dynamics(self, element: ElementTree.Element | None, key: str, where: str) -> float:
        return 0.0 if element is None else self._number(element, key, f"{where}: <dynamics>", "0")

    def _origin(self, element: ElementTree.Element, where: str) -> pin.SE3:
        origin = self._only(element, "origin", where)
        if origin is None:
            return pin.SE3.Identity()
        place = f"{where} <origin>"
        translation = self._vector(origin, "xyz", place, "0 0 0")
        angles = self._vector(origin, "rpy", place, "0 0 0")
        for k, word in enumerate(origin.get("rpy", "0 0 0").split()[:3]):
            if len(word) <= _EXACT_ANGLE:
                angles[k] = _right_angle(angles[k])
        return pin.SE3(pin.rpy.rpyToMatrix(*angles), translation)

    def _vector(
        self, element: ElementTree.Element, key: str, where: str, default: str
    ) -> FloatArray:
        words = element.get(key, default).split()
        if len(words) != 3:
            self.problems.append(f"{where}: {key} has {len(words)} numbers, not 3")
            return np.zeros(3)
        return np.array([self._value(word, f"{where}: {key}", LARGEST) for word in words])

    def _number(
        self,
        element: ElementTree.Element,
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


def _right_angle(angle: float) -> float:
    nearest = round(angle / (math.pi / 2)) * (math.pi / 2)
    return nearest if abs(angle - nearest) < RIGHT_ANGLE_TOLERANCE else angle


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
