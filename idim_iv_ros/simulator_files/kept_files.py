"""A user's URDF or MJCF with other values in it, and links or bodies for payloads.

Comments, order and line ends are kept; blanks may change. An `<inertial>` keeps its form:
`fullinertia` in the axes of the body, or `diaginertia` with a `quat`. Attributes that a default
class gives are written at the joint itself.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import Any
from xml.dom import minidom
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers.expat import ExpatError

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.mjcf import compiled_mjcf, element, native_elements
from idim_iv_ros.model.urdf import UrdfJoint
from idim_iv_ros.simulator_files.mjcf import (
    comment,
    friction_solver,
    inertial_of,
    number_text,
    numbers_text,
)
from idim_iv_ros.simulator_files.named import Load
from idim_iv_ros.simulator_files.robot import ExportedRobot, JointValues
from idim_iv_ros.types import FloatArray

# What puts other elements in its place, so that a body that moves is not one of this file's own.
_MADE_ELSEWHERE = ("include", "attach", "replicate", "composite", "flexcomp")
_TURNS = ("axisangle", "euler", "xyaxes", "zaxis")
_CHANGES_INERTIALS = ("balanceinertia", "fusestatic", "boundmass", "boundinertia", "settotalmass")
_DEFAULT_SOLVER = (0.02, 1.0)  # solreffriction of MuJoCo: another one is the user's
_NEAR = 0.1  # of it: known no better from a recording
_ROUNDING = 1e-14  # Smaller relative differences are rounding errors of sums

_DECLARATION = re.compile(rb"\s*<\?xml[^>]*\?>")


def read_xml(content: bytes, source: str) -> Any:
    """Parse the document of a file; `source` names it in messages.

    Raises UsageError: no XML, UTF-16, or definitions of entities.
    """
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise UsageError(f"{source}: is UTF-16; write it as UTF-8")
    if b"<!ENTITY" in content:
        raise UsageError(f"{source}: declares XML entities, which no robot model has")
    try:
        return minidom.parseString(content)
    except ExpatError as error:
        raise UsageError(f"{source}: not XML whose values can be changed: {error}") from error


def written_xml(document: Any, content: bytes) -> bytes:
    """Return the text of a document with the declaration, encoding and line ends of its file."""
    declaration = _DECLARATION.match(content.removeprefix(b"\xef\xbb\xbf"))
    parts = [] if declaration is None else [declaration[0].strip().decode()]
    parts += [node.toxml() for node in document.childNodes]
    text = "\n".join(parts) + ("\n" if content.endswith(b"\n") else "")
    if b"\r\n" in content:
        text = text.replace("\n", "\r\n")
    return text.encode(document.encoding or "utf-8", "xmlcharrefreplace")


def elements(parent: Any, *tags: str) -> Iterator[Any]:
    """Return the child elements in their order, only those with some names if any are given."""
    for node in parent.childNodes:
        if node.nodeType == node.ELEMENT_NODE and (not tags or node.tagName in tags):
            yield node


def set_values(node: Any, values: Mapping[str, str], *, zeros: bool = False) -> None:
    """Set attributes whose values differ; add missing ones.

    With `zeros`, missing attributes are added even if zero.
    """
    for key, text in values.items():
        new = [float(word) for word in text.split()]
        if node.hasAttribute(key):
            old = [float(word) for word in node.getAttribute(key).split()]
            # The same but for rounding stays as it is written.
            if len(new) != len(old) or not np.allclose(new, old, rtol=1e-12, atol=0.0):
                node.setAttribute(key, text)
        elif zeros or any(new):
            node.setAttribute(key, text)


def set_child(parent: Any, tag: str, values: Mapping[str, str], *, first: bool) -> None:
    """Set attributes of a child element, which is inserted if missing."""
    child = next(elements(parent, tag), None)
    if child is None:
        insert(parent, Element(tag, dict(values)), first=first)
    else:
        set_values(child, values)


def insert(parent: Any, *new: Element, first: bool) -> None:
    """Insert elements and comments after the start tag of an element, or before its end tag."""
    indent, ancestor = "\n", parent
    while ancestor.nodeType != ancestor.DOCUMENT_NODE:
        indent, ancestor = indent + "  ", ancestor.parentNode
    text = ""
    for node in new:
        ElementTree.indent(node)
        text += indent + ElementTree.tostring(node, encoding="unicode").replace("\n", indent)
    before = parent.firstChild if first else parent.lastChild
    if not first and before is not None and before.nodeType != before.TEXT_NODE:
        before = None
    if before is None:
        text += indent[:-2]
    parsed: Any = minidom.parseString(f"<new>{text}</new>").documentElement
    for node in list(parsed.childNodes):
        parent.insertBefore(parent.ownerDocument.importNode(node, True), before)


def with_mjcf_values(exported: ExportedRobot) -> tuple[bytes, tuple[str, ...]]:
    """Return the user's MJCF with other values and bodies for payloads, and notes.

    Raises UsageError: the file takes bodies from an asset or generates them, or has settings that
    change inertials; or the values of a joint or body cannot be written separately.
    """
    content, path = exported.content, exported.source
    document = read_xml(content, str(path))
    notes: tuple[str, ...] = ()
    nodes = list(document.getElementsByTagName("*"))
    if refers := next(filter(None, (node.getAttribute("file") for node in nodes)), ""):
        notes += (
            f"the MJCF refers to other files ({refers} and so on) as before, relative to its own "
            "folder: put it beside the file that it was made from, under another name, or copy "
            "these files to it",
        )
    for node in nodes:
        if node.tagName in _MADE_ELSEWHERE:
            raise UsageError(
                f"{path}: <{node.tagName}> makes bodies or takes them from elsewhere: write "
                "them out (`mj_saveLastXML` does)"
            )
    mujoco, spec, model = compiled_mjcf(path)
    always = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE)
    settings = ['inertiafromgeom="true"'] if int(spec.compiler.inertiafromgeom) == always else []
    # A version of MuJoCo need not have all of them.
    settings += [name for name in _CHANGES_INERTIALS if getattr(spec.compiler, name, 0) > 0]
    if settings:
        raise UsageError(
            f"{path}: <compiler> has {', '.join(settings)}, so that the <inertial> of a body is "
            "not what is simulated: write the inertials out without it (`mj_saveLastXML` does)"
        )
    effects = [name for name, places in native_elements(mujoco, model).items() if places]
    if effects:
        raise UsageError(
            f"{path}: holds {', '.join(effects)} of an earlier export, which the new effects "
            "would count twice: export with the MJCF or URDF that was there before"
        )
    bodies = {body.getAttribute("name"): body for body in document.getElementsByTagName("body")}
    file = _Mjcf(mujoco, model, bodies, str(path))
    for place, name in enumerate(exported.robot.joints):
        file.set_joint(exported.urdf.joints[name], exported.drives, place)
    links, _ = exported.links
    without = [name for name, body in links.items() if not file.set_inertial(name, body)]
    for name, (link, load) in exported.mounted.items():
        inertial, pos = element("inertial", **inertial_of(load.body)), file.anchor(link)
        body = element("body", inertial, name=name, pos=numbers_text(pos))
        insert(file.body(link), comment(load.words), body, first=True)
    if without:
        notes += (
            f"the inertia of {', '.join(without)} was that of geoms; it has an <inertial> now, so "
            "that the mass of its geoms no longer counts",
        )
    return written_xml(document, content), notes


def _body_elements(body: Any, *tags: str) -> Iterator[Any]:
    """Return the elements of a body, also those in a <frame>, which belongs to the same body."""
    for node in elements(body, "frame", *tags):
        if node.tagName == "frame":
            yield from _body_elements(node, *tags)
        else:
            yield node


@dataclass(frozen=True)
class _Mjcf:
    """An MJCF document with its compiled model and its bodies by name; `source` for messages."""

    mujoco: Any
    model: Any
    bodies: Mapping[str, Any]
    source: str

    def set_joint(self, given: UrdfJoint, values: JointValues, place: int) -> None:
        """Set armature, damping and friction of a joint, less the parts that its actuators have."""
        for link, body in self.bodies.items():
            joints = list(_body_elements(body, "joint", "freejoint"))
            names = [joint.getAttribute("name") for joint in joints]
            if (given.name in names and len(joints) > 1) or (
                link == given.child and len(joints) != 1
            ):
                raise UsageError(
                    f"{self.source}: body {link} has {len(joints)} joints, and one <inertial> "
                    f"cannot hold what each of them carries: give {given.name} a body of its own"
                )
        joint = next(_body_elements(self.body(given.child), "joint", "freejoint"))
        dof = int(self.model.jnt_dofadr[int(self.model.body(given.child).jntadr[0])])
        changed = {}
        for key, all_wanted, nominal in (
            ("armature", values.armature, given.armature),
            ("damping", values.damping, given.damping),
            ("frictionloss", values.friction, None),
        ):
            wanted = float(all_wanted[place])
            now = float(np.ravel(getattr(self.model, f"dof_{key}")[dof])[0])
            # What the compiled joint has less than the nominal model is that of actuators.
            of_actuators = 0.0 if nominal is None else nominal - now
            value = wanted - of_actuators
            if value < -_ROUNDING * max(1.0, abs(of_actuators)):
                raise UsageError(
                    f"{self.source}: joint {given.name}: its actuators alone have more {key} "
                    f"({of_actuators:.6g}) than was found ({wanted:.6g}): take it out of the "
                    "actuators"
                )
            if abs(value - now) > _ROUNDING * (abs(now) + abs(of_actuators)):
                changed[key] = number_text(max(value, 0.0))
        solver = friction_solver(float(values.lead[place]), float(self.model.opt.timestep))
        constant, ratio = self.model.dof_solref[dof]
        near = abs(float(solver["solreffriction"].split()[0]) / constant - 1.0) < _NEAR
        if values.friction[place] > 0.0 and (constant, ratio) == _DEFAULT_SOLVER and not near:
            changed |= solver
        set_values(joint, changed, zeros=True)

    def body(self, link: str) -> Any:
        if link not in self.bodies:
            raise UsageError(
                f"{self.source}: {link} is no named <body> of this file: give each body that "
                "moves a name and one joint"
            )
        return self.bodies[link]

    def set_inertial(self, link: str, new: pin.Inertia) -> bool:
        """Set the inertial of a link; return False if the body had none."""
        values = inertial_of(new, self.anchor(link))
        inertial = next(_body_elements(self.body(link), "inertial"), None)
        if inertial is None:
            insert(self.body(link), Element("inertial", values), first=True)
            return False
        full = values.pop("fullinertia")
        set_values(inertial, values, zeros=True)
        if not inertial.hasAttribute("diaginertia"):
            set_values(inertial, {"fullinertia": full})
            return True
        w, x, y, z = (float(component) for component in self.model.body(link).iquat)
        moments, quaternion = _principal(new.inertia, pin.Quaternion(w, x, y, z).matrix())
        for turn in filter(inertial.hasAttribute, _TURNS):
            inertial.removeAttribute(turn)
        principal = {"diaginertia": numbers_text(moments), "quat": numbers_text(quaternion)}
        set_values(inertial, principal)
        return True

    def anchor(self, link: str) -> FloatArray:
        """Return the vector from a body's frame to its link's, m, as `mjcf_as_urdf` places it."""
        body, types = self.model.body(link), self.mujoco.mjtJoint
        last = int(body.jntadr[0] + body.jntnum[0]) - 1
        moving = (int(types.mjJNT_HINGE), int(types.mjJNT_SLIDE))
        if body.jntnum[0] == 0 or int(self.model.jnt_type[last]) not in moving:
            return np.zeros(3)
        return np.array(self.model.jnt_pos[last])


def _principal(inertia: FloatArray, before: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the principal moments (3,) and axes as quaternion (4,), w first, of `inertia`.

    Order and signs are nearest to the axes `before` (3, 3), so that a small change of a body
    changes its numbers little.
    """
    moments, axes = np.linalg.eigh(inertia)
    overlap = np.abs(before.T @ axes)
    order = max(permutations(range(3)), key=lambda order: overlap[range(3), order].sum())
    moments, axes = moments[list(order)], axes[:, list(order)]
    along = np.diag(before.T @ axes)
    axes = axes * np.where(along < 0.0, -1.0, 1.0)
    if np.linalg.det(axes) < 0.0:
        axes[:, int(np.argmin(np.abs(along)))] *= -1.0
    return moments, np.roll(pin.Quaternion(axes).coeffs(), 1)


_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")  # the upper triangle


def with_values(
    content: bytes,
    links: Mapping[str, pin.Inertia],
    dynamics: Mapping[str, Mapping[str, float]],
    mounted: Mapping[str, tuple[str, Load]],
    source: str,
) -> bytes:
    """Return the URDF with other values; everything else but blanks is kept.

    `links` are inertials by name, inserted where a link has none; `dynamics` are ``damping`` and
    ``friction`` of joints by name; `mounted` are payloads by the name of their new link, each with
    the link that carries it.

    Raises UsageError: as `read_xml`, with `source` as the name of the URDF.
    """
    document = read_xml(content, source)
    robot = document.documentElement
    places = {
        (child.tagName, child.getAttribute("name")): child
        for child in elements(robot, "link", "joint")
    }
    for name, body in links.items():
        _set_inertial(places["link", name], body)
    for name, values in dynamics.items():
        texts = {key: number_text(value) for key, value in values.items()}
        set_child(places["joint", name], "dynamics", texts, first=False)
    for name, (carrier, load) in mounted.items():
        ends = element("parent", link=carrier), element("child", link=name)
        joint = element("joint", *ends, name=f"{name}_fixed", type="fixed")
        link = element("link", _inertial(load.body), name=name)
        insert(robot, comment(load.words), link, joint, first=False)
    return written_xml(document, content)


def _inertial(body: pin.Inertia) -> Element:
    moments = numbers_text(body.inertia[np.triu_indices(3)]).split()
    return element(
        "inertial",
        element("origin", xyz=numbers_text(body.lever), rpy="0 0 0"),
        element("mass", value=number_text(body.mass)),
        element("inertia", **dict(zip(_MOMENTS, moments, strict=True))),
    )


def _set_inertial(link: Any, body: pin.Inertia) -> None:
    new, inertial = _inertial(body), next(elements(link, "inertial"), None)
    if inertial is None:
        insert(link, new, first=True)
        return
    centre, *numbers = new
    for child in numbers:
        set_values(next(elements(inertial, child.tag)), child.attrib)
    # The moments are written in the axes of the link: whoever turns them by an angle of few digits
    # gets the same.
    origin = next(elements(inertial, "origin"), None)
    if origin is not None and not any(map(float, origin.getAttribute("rpy").split())):
        del centre.attrib["rpy"]
    set_child(inertial, "origin", centre.attrib, first=True)
