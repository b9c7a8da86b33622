"""From an MJCF file to the text of a URDF with the same bodies, joints and numbers.

MuJoCo reads the file: defaults, classes, `include`, inertias from geometry and units of angles are
its own. What a URDF has no place for (armature, where a joint that is not identified stays, what
ties joints to each other) is in one element `<idim_iv_ros>` of each joint and of the robot, which
other readers of URDF pass over.

MuJoCo's frame of a body is where it is at `qpos0`. A joint turns about its anchor `pos`, so that
the frame of the link behind it lies there, with the axes of the body; `ref` is the position at
`qpos0`.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from idim_iv_ros.model.mjcf_ties import extra_forces, notes, tied_joints
from idim_iv_ros.model.mujoco_package import load_mujoco, mujoco_reads
from idim_iv_ros.types import FloatArray

EXTENSION = "idim_iv_ros"
_HOME = "home"


def is_mjcf(text: str) -> bool:
    """Whether the root element of an XML text is that of an MJCF."""
    bare = re.sub(r"<!--.*?-->|<\?.*?\?>", "", text, flags=re.DOTALL)
    root = re.search(r"<([A-Za-z_][\w.-]*)", bare)
    return root is not None and root[1] == "mujoco"


def mjcf_as_urdf(path: Path, text: str | None = None) -> str:
    """Return a URDF of the bodies and joints of an MJCF file, numbers with all their digits.

    - `text`: in place of that of the file, in whose folder it is read

    Raises UsageError: MuJoCo is not installed or cannot read the file; a mesh that the inertia of a
    moving body needs is missing.
    """
    mujoco, spec, model = compiled_mjcf(path, text)
    return _Writer(mujoco, model, spec.modelname or path.stem).text()


def compiled_mjcf(path: Path, text: str | None = None) -> tuple[Any, Any, Any]:
    """Return the module `mujoco`, the specification and the model, without drawings.

    Raises UsageError: as `mjcf_as_urdf`.
    """
    mujoco = load_mujoco(f"{path}: an MJCF file")
    with mujoco_reads(path):
        if text is None:
            spec = mujoco.MjSpec.from_file(str(path))
        else:
            spec = mujoco.MjSpec.from_string(text)
            spec.modelfiledir = str(path.parent)
        _without_drawings(mujoco, spec)
        model = spec.compile()
    return mujoco, spec, model


def _without_drawings(mujoco: Any, spec: Any) -> None:
    """Take out what is only seen: its files are often missing, and no inertia depends on it.

    A mesh stays where it gives the inertia of a body that moves.
    """
    from_geometry = (
        spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    )
    files = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)
    needed = set()
    for geom in list(spec.geoms):
        geom.material = ""
        if geom.type not in files and not geom.meshname:
            continue
        body = geom.parent
        if _moves(body) and (from_geometry or not body.explicitinertial):
            needed.add(geom.meshname)
        else:
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.name not in needed:
            spec.delete(mesh)
    for site in (*spec.sites, *spec.tendons):
        site.material = ""
    drawings = (spec.materials, spec.textures, spec.hfields, spec.skins, spec.sensors, spec.pairs)
    for kind in drawings:
        for member in list(kind):
            spec.delete(member)


def _moves(body: Any) -> bool:
    while body is not None and body.name != "world":
        if len(body.joints):
            return True
        body = body.parent
    return False


@dataclass
class _Writer:
    """Elements of a URDF from a compiled model."""

    mujoco: Any
    model: Any
    name: str
    # From the frame of each body to that of its link, m.
    anchors: dict[int, FloatArray] = field(default_factory=dict)

    def text(self) -> str:
        root = ElementTree.Element("robot", name=self.name)
        extension = ElementTree.SubElement(root, EXTENSION, source="mjcf")
        for note in notes(self.mujoco, self.model):
            ElementTree.SubElement(extension, "note").text = note
        self.names = _joint_names(self.model)
        self.tied = tied_joints(self.mujoco, self.model)
        self.extra = extra_forces(self.mujoco, self.model)
        self.home = self._home()
        ElementTree.SubElement(root, "link", name=self._link(0))
        self.anchors[0] = np.zeros(3)
        for body in range(1, self.model.nbody):
            self._body(root, body)
        ElementTree.indent(root)
        return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"

    def _link(self, body: int) -> str:
        return str(self.model.body(body).name) or f"body_{body}"

    def _home(self) -> FloatArray:
        """Positions of `qpos` where joints that are not identified stay."""
        for key in range(self.model.nkey):
            if self.model.key(key).name == _HOME:
                return np.array(self.model.key_qpos[key])
        return np.array(self.model.qpos0)

    def _body(self, root: ElementTree.Element, body: int) -> None:
        model = self.model
        parent = int(model.body_parentid[body])
        carrier = self._link(parent)
        placement = pin.SE3(np.eye(3), -self.anchors[parent]) * _placement(
            model.body_pos[body], model.body_quat[body]
        )
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        anchor = np.zeros(3)
        if count == 0:
            name = f"{self._link(body)}_fixed"
            _origin(_joint(root, name, "fixed", carrier, self._link(body)), placement)
        for index in range(first, first + count):
            last = index == first + count - 1
            child = self._link(body) if last else f"{self._link(body)}_{self.names[index]}"
            if not last:
                ElementTree.SubElement(root, "link", name=child)
            placement, anchor = self._moving(root, index, carrier, child, placement, anchor)
            carrier = child
        self.anchors[body] = anchor
        link = ElementTree.SubElement(root, "link", name=self._link(body))
        _inertial(link, model, body, anchor)

    def _moving(
        self,
        root: ElementTree.Element,
        index: int,
        carrier: str,
        child: str,
        placement: pin.SE3,
        before: FloatArray,
    ) -> tuple[pin.SE3, FloatArray]:
        """Write one joint; returns the placement of what follows and the joint's anchor."""
        model, types = self.model, self.mujoco.mjtJoint
        kind, anchor = model.jnt_type[index], np.array(model.jnt_pos[index])
        axis, place = np.array(model.jnt_axis[index]), int(model.jnt_qposadr[index])
        hinge, slide = kind == types.mjJNT_HINGE, kind == types.mjJNT_SLIDE
        limited = bool(model.jnt_limited[index])
        urdf_type = "prismatic" if slide else "revolute" if limited else "continuous"
        if not (hinge or slide):
            urdf_type, anchor = "floating", np.zeros(3)
        joint = _joint(root, self.names[index], urdf_type, carrier, child)
        placement = placement * pin.SE3(np.eye(3), anchor - before)
        if hinge or slide:
            reference = float(model.qpos0[place])
            placement = placement * joint_motion(urdf_type, axis, -reference)
            ElementTree.SubElement(joint, "axis", xyz=_numbers(axis))
            self._numbers_of(joint, index, limited)
        _origin(joint, placement)
        extension = ElementTree.SubElement(joint, EXTENSION)
        if hinge or slide:
            dof = int(model.jnt_dofadr[index])
            extension.set("armature", _numbers([model.dof_armature[dof] + self._motor(index)[1]]))
            extension.set("rest", _numbers([self.home[place]]))
        for key, reasons in (("tied", self.tied), ("beyond", self.extra)):
            if index in reasons:
                extension.set(key, reasons[index])
        return pin.SE3.Identity(), anchor

    def _numbers_of(self, joint: ElementTree.Element, index: int, limited: bool) -> None:
        model = self.model
        limits = {}
        if limited:
            lower, upper = model.jnt_range[index]
            limits = {"lower": _numbers([lower]), "upper": _numbers([upper])}
        effort, _, damping = self._motor(index)
        if np.isfinite(effort):
            limits["effort"] = _numbers([effort])
        if limits:
            ElementTree.SubElement(joint, "limit", limits)
        dof = int(model.jnt_dofadr[index])
        ElementTree.SubElement(
            joint,
            "dynamics",
            damping=_numbers([model.dof_damping[dof] + damping]),
            friction=_numbers([model.dof_frictionloss[dof]]),
        )

    def _motor(self, index: int) -> tuple[float, float, float]:
        """Largest torque of the joint's actuators, their armature and damping at the joint."""
        model = self.model
        effort = float(np.abs(model.jnt_actfrcrange[index]).max())
        effort = effort if model.jnt_actfrclimited[index] else np.inf
        armature = damping = 0.0
        for actuator in range(model.nu):
            if model.actuator_trntype[actuator] != self.mujoco.mjtTrn.mjTRN_JOINT:
                continue
            if int(model.actuator_trnid[actuator, 0]) != index:
                continue
            gear = float(model.actuator_gear[actuator, 0])
            if model.actuator_forcelimited[actuator]:
                largest = float(np.abs(model.actuator_forcerange[actuator]).max())
                effort = min(effort, abs(gear) * largest)
            armature += gear**2 * _first(getattr(model, "actuator_armature", None), actuator)
            damping += gear**2 * _first(getattr(model, "actuator_damping", None), actuator)
        return effort, armature, damping


def _joint(
    root: ElementTree.Element, name: str, urdf_type: str, parent: str, child: str
) -> ElementTree.Element:
    joint = ElementTree.SubElement(root, "joint", name=name, type=urdf_type)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    return joint


def _first(values: Any, index: int) -> float:
    """Value of an actuator; zero where this version of MuJoCo has none."""
    return 0.0 if values is None else float(np.ravel(values[index])[0])


def _joint_names(model: Any) -> dict[int, str]:
    """Names of joints; those that have none are called after their body."""
    names: dict[int, str] = {}
    for index in range(model.njnt):
        body = int(model.jnt_bodyid[index])
        given_name = model.joint(index).name
        place = index - int(model.body_jntadr[body]) + 1
        names[index] = given_name or f"{model.body(body).name or f'body_{body}'}_joint_{place}"
    return names


def joint_motion(urdf_type: str, axis: FloatArray, position: float) -> pin.SE3:
    """Placement behind a joint at a position, in the frame before it."""
    unit = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    if urdf_type == "prismatic":
        return pin.SE3(np.eye(3), unit * position)
    return pin.SE3(np.asarray(pin.AngleAxis(position, unit).toRotationMatrix()), np.zeros(3))


def _placement(position: FloatArray, quaternion: FloatArray) -> pin.SE3:
    w, x, y, z = (float(component) for component in quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position))


def _origin(joint: ElementTree.Element, placement: pin.SE3) -> None:
    angles = pin.rpy.matrixToRpy(placement.rotation)
    ElementTree.SubElement(
        joint, "origin", xyz=_numbers(placement.translation), rpy=_numbers(angles)
    )


def _inertial(link: ElementTree.Element, model: Any, body: int, anchor: FloatArray) -> None:
    if model.body_mass[body] <= 0.0:
        return
    element = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(element, "origin", xyz=_numbers(model.body_ipos[body] - anchor))
    ElementTree.SubElement(element, "mass", value=_numbers([model.body_mass[body]]))
    turned = _placement(np.zeros(3), model.body_iquat[body]).rotation
    inertia = turned @ np.diag(model.body_inertia[body]) @ turned.T
    moments = {
        f"i{'xyz'[i]}{'xyz'[j]}": _numbers([inertia[i, j]]) for i in range(3) for j in range(i, 3)
    }
    ElementTree.SubElement(element, "inertia", moments)


def _numbers(values: Any) -> str:
    """All digits, and so many of them that no reader takes an angle for one that was rounded."""
    return " ".join(f"{float(value):.17e}" for value in values)
