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
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError
from idim_iv_ros.types import FloatArray

_PREFIXES = re.compile(r"^((XML )?Error: |Schema violation: |ParseXML: )+")


def load_mujoco(needed_for: str) -> Any:
    """Return the module `mujoco`; `needed_for` is what needs it, in words.

    Raises UsageError: it is not installed, or cannot be loaded.
    """
    try:
        return import_module("mujoco")
    except ImportError as error:
        raise UsageError(
            f"{needed_for} needs MuJoCo: pip install 'idim-iv-ros[mujoco]' ({error})"
        ) from error


def set_first(element: Any, name: str, value: float) -> None:
    """Set a number of an element that newer versions of MuJoCo hold as that of a polynomial."""
    more = len(np.atleast_1d(getattr(element, name))) - 1
    setattr(element, name, [value, *[0.0] * more] if more else value)


@contextmanager
def mujoco_warnings() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings; else it writes them to MUJOCO_LOG.TXT in the present folder."""
    mujoco, warned = import_module("mujoco"), list[str]()
    mujoco.set_mju_user_warning(warned.append)
    try:
        yield warned
    finally:
        mujoco.set_mju_user_warning(None)


@contextmanager
def mujoco_reads(path: object) -> Iterator[None]:
    """Say in one line of a file what MuJoCo says in several, or only warns of.

    Raises UsageError: MuJoCo refuses the file, or a number in it is NaN.
    """
    problem = ""
    with mujoco_warnings() as warned:
        try:
            yield
        except UsageError:
            raise
        except Exception as error:  # ValueError, FatalError and others
            problem = str(error)
    if any("NaN" in text for text in warned):
        raise UsageError(f"{path}: a number in it is NaN")
    if problem:
        raise UsageError(f"{path}: {_PREFIXES.sub('', ' '.join(problem.split()))}")


# Effects that an exported MJCF holds as elements of its own. A tuple of `custom` by this name lists
# the joints or tendons: they are no part of the nominal model, and `notes` says so.
DAMPING, SPRING, COUPLING = "nonlinear_viscous", "spring", "joint_coupling"


def native_elements(mujoco: Any, model: Any) -> dict[str, list[int]]:
    """Joints (for a coupling: tendons) whose elements are effects of an export, by effect."""
    elements: dict[str, list[int]] = {}
    for effect, kind in (
        (DAMPING, mujoco.mjtObj.mjOBJ_JOINT),
        (SPRING, mujoco.mjtObj.mjOBJ_JOINT),
        (COUPLING, mujoco.mjtObj.mjOBJ_TENDON),
    ):
        index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TUPLE, effect)
        if index < 0:
            continue
        first = int(model.tuple_adr[index])
        places = range(first, first + int(model.tuple_size[index]))
        elements[effect] = [
            int(model.tuple_objid[place]) for place in places if model.tuple_objtype[place] == kind
        ]
    return elements


def tied_joints(mujoco: Any, model: Any) -> dict[int, str]:
    """Free and ball joints, and joints that something ties, by number: what it is, in words."""
    reasons: dict[int, list[str]] = defaultdict(list)
    types = mujoco.mjtJoint
    kinds = {types.mjJNT_FREE: "a free joint", types.mjJNT_BALL: "a ball joint"}
    for joint in range(model.njnt):
        if (words := kinds.get(types(model.jnt_type[joint]))) is not None:
            reasons[joint].append(words)
    for equality in np.flatnonzero(model.eq_active0).tolist():
        words = f"tied by the equality {model.equality(equality).name}".strip()
        for joint in _of_equality(mujoco, model, equality):
            reasons[joint].append(words)
    effects = native_elements(mujoco, model).get(COUPLING, [])
    for tendon in range(model.ntendon):
        if tendon not in effects and _acts(mujoco, model, tendon):
            words = f"driven by the tendon {model.tendon(tendon).name}".strip()
            for joint in _of_tendon(mujoco, model, tendon):
                reasons[joint].append(words)
    return {joint: " and ".join(dict.fromkeys(words)) for joint, words in reasons.items()}


def _of_equality(mujoco: Any, model: Any, equality: int) -> set[int]:
    """Joints that an equality ties to each other or to the world."""
    kind, kinds = model.eq_type[equality], mujoco.mjtEq
    first, second = int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])
    if kind == kinds.mjEQ_JOINT:
        return {joint for joint in (first, second) if joint >= 0}
    if kind == kinds.mjEQ_TENDON:
        both = (tendon for tendon in (first, second) if tendon >= 0)
        return set().union(*(_of_tendon(mujoco, model, tendon) for tendon in both))
    if kind == kinds.mjEQ_CONNECT or kind == kinds.mjEQ_WELD:
        if model.eq_objtype[equality] == mujoco.mjtObj.mjOBJ_SITE:
            first, second = int(model.site_bodyid[first]), int(model.site_bodyid[second])
        return _between(model, [first, second])
    return set()


def _acts(mujoco: Any, model: Any, tendon: int) -> bool:
    """Whether a tendon does more than to measure a length."""
    numbers = (model.tendon_stiffness, model.tendon_damping, model.tendon_frictionloss)
    armature = getattr(model, "tendon_armature", np.zeros(model.ntendon))
    driven = model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    loaded = any(float(number[tendon]) != 0.0 for number in (*numbers, armature))
    pulled = np.any(driven & (model.actuator_trnid[:, 0] == tendon))
    return bool(loaded or model.tendon_limited[tendon] or pulled)


def _of_tendon(mujoco: Any, model: Any, tendon: int) -> set[int]:
    """Joints that a tendon pulls: those it wraps, and those between the bodies of its sites."""
    joints: set[int] = set()
    bodies = []
    first = int(model.tendon_adr[tendon])
    for wrap in range(first, first + int(model.tendon_num[tendon])):
        kind, index = model.wrap_type[wrap], int(model.wrap_objid[wrap])
        if kind == mujoco.mjtWrap.mjWRAP_JOINT:
            joints.add(index)
        elif kind == mujoco.mjtWrap.mjWRAP_SITE:
            bodies.append(int(model.site_bodyid[index]))
    return joints | _between(model, bodies)


def _between(model: Any, bodies: list[int]) -> set[int]:
    """Joints on the paths between bodies: those that do not carry all of them."""
    carriers: list[set[int]] = []
    for body in bodies:
        carriers.append(set())
        while body > 0:
            first = int(model.body_jntadr[body])
            carriers[-1].update(range(first, first + int(model.body_jntnum[body])))
            body = int(model.body_parentid[body])
    joints: set[int] = set()
    return joints.union(*carriers) - carriers[0].intersection(*carriers) if carriers else joints


def extra_forces(mujoco: Any, model: Any) -> dict[int, str]:
    """Say of joints what acts on them that the nominal model has no term for."""
    forces: dict[int, list[str]] = defaultdict(list)
    effects = native_elements(mujoco, model)
    # Coefficients beyond the first, where this version of MuJoCo has them.
    springs = getattr(model, "jnt_stiffnesspoly", np.zeros((model.njnt, 1)))
    dampers = getattr(model, "dof_dampingpoly", np.zeros((model.nv, 1)))
    for joint in range(model.njnt):
        sprung = model.jnt_stiffness[joint] or np.any(springs[joint])
        if sprung and joint not in effects.get(SPRING, []):
            forces[joint].append("a spring (stiffness)")
        curved = np.any(dampers[int(model.jnt_dofadr[joint])])
        if curved and joint not in effects.get(DAMPING, []):
            forces[joint].append("nonlinear damping")
    special = getattr(mujoco.mjtGain, "mjGAIN_DCMOTOR", -1)
    at_joints = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    for actuator in np.flatnonzero(at_joints & (model.actuator_gaintype == special)):
        forces[int(model.actuator_trnid[actuator, 0])].append("a dcmotor")
    return {joint: " and ".join(words) for joint, words in forces.items()}


def notes(mujoco: Any, model: Any) -> list[str]:
    """Sentences on what the file has and the nominal model leaves out (effects, contacts)."""
    sentences = []
    for effect, elements in native_elements(mujoco, model).items():
        one = model.tendon if effect == COUPLING else model.joint
        listed = ", ".join(one(index).name for index in elements)
        sentences.append(
            f"{effect} of {listed}, which an export put there, is an effect and no part of the "
            "nominal model"
        )
    compensated = [model.body(b).name for b in range(model.nbody) if model.body_gravcomp[b] != 0.0]
    if compensated:
        listed = ", ".join(name or "an unnamed body" for name in compensated)
        sentences.append(
            f"gravcomp of {listed} is passed over: the nominal model feels all gravity"
        )
    if model.opt.density > 0.0 or model.opt.viscosity > 0.0:
        sentences.append("density and viscosity of the medium are passed over")
    return sentences


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
        body = carrier = geom.parent
        while carrier is not None and carrier.name != "world" and not len(carrier.joints):
            carrier = carrier.parent
        moves = carrier is not None and carrier.name != "world"
        if moves and (from_geometry or not body.explicitinertial):
            needed.add(geom.meshname)
        else:
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if mesh.name not in needed:
            spec.delete(mesh)
    for site in (*spec.sites, *spec.tendons):
        site.material = ""
    for kind in (spec.materials, spec.textures, spec.hfields, spec.skins, spec.sensors, spec.pairs):
        for member in list(kind):
            spec.delete(member)


@dataclass
class _Writer:
    """Elements of a URDF from a compiled model."""

    mujoco: Any
    model: Any
    name: str
    # From the frame of each body to that of its link, m.
    anchors: dict[int, FloatArray] = field(default_factory=lambda: {0: np.zeros(3)})

    def text(self) -> str:
        model = self.model
        extension = element(EXTENSION, source="mjcf")
        for note in notes(self.mujoco, model):
            ElementTree.SubElement(extension, "note").text = note
        self.tied = tied_joints(self.mujoco, model)
        self.extra = extra_forces(self.mujoco, model)
        # Where joints that are not identified stay.
        homes = [key for key in range(model.nkey) if model.key(key).name == _HOME]
        self.home = np.array(model.key_qpos[homes[0]] if homes else model.qpos0)
        root = element("robot", extension, element("link", name=self._link(0)), name=self.name)
        for body in range(1, model.nbody):
            root.extend(self._body(body))
        ElementTree.indent(root)
        return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"

    def _link(self, body: int) -> str:
        return str(self.model.body(body).name) or f"body_{body}"

    def _name(self, joint: int) -> str:
        body = int(self.model.jnt_bodyid[joint])
        place = joint - int(self.model.body_jntadr[body]) + 1
        return self.model.joint(joint).name or f"{self._link(body)}_joint_{place}"

    def _body(self, body: int) -> Iterator[Element]:
        """The link of a body, behind its joints and the links between them."""
        model, link = self.model, self._link(body)
        parent = int(model.body_parentid[body])
        carrier, anchor = self._link(parent), np.zeros(3)
        placement = pin.SE3(np.eye(3), -self.anchors[parent]) * _placement(
            model.body_pos[body], model.body_quat[body]
        )
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if count == 0:
            yield _joint(f"{link}_fixed", "fixed", carrier, link, _origin(placement))
        for index in range(first, first + count):
            child = link
            if index < first + count - 1:
                child = f"{link}_{self._name(index)}"
                yield element("link", name=child)
            joint, before = self._moving(index, carrier, child, placement, anchor)
            yield joint
            carrier, placement, anchor = child, pin.SE3.Identity(), before
        self.anchors[body] = anchor
        yield element("link", *_inertial(model, body, anchor), name=link)

    def _moving(
        self, index: int, carrier: str, child: str, placement: pin.SE3, before: FloatArray
    ) -> tuple[Element, FloatArray]:
        """Return one joint behind an anchor, and its own anchor."""
        model, types = self.model, self.mujoco.mjtJoint
        kind, anchor = model.jnt_type[index], np.array(model.jnt_pos[index])
        axis, place = np.array(model.jnt_axis[index]), int(model.jnt_qposadr[index])
        hinge, slide = kind == types.mjJNT_HINGE, kind == types.mjJNT_SLIDE
        limited = bool(model.jnt_limited[index])
        urdf_type = "prismatic" if slide else "revolute" if limited else "continuous"
        if not (hinge or slide):
            urdf_type, anchor = "floating", np.zeros(3)
        placement = placement * pin.SE3(np.eye(3), anchor - before)
        parts, beyond, limits = [], {}, {}
        if hinge or slide:
            reference, dof = float(model.qpos0[place]), int(model.jnt_dofadr[index])
            placement = placement * joint_motion(urdf_type, axis, -reference)
            effort, armature, damping = self._motor(index)
            if limited:
                lower, upper = model.jnt_range[index]
                limits = {"lower": _numbers(lower), "upper": _numbers(upper)}
            if np.isfinite(effort):
                limits["effort"] = _numbers(effort)
            friction = {
                "damping": _numbers(model.dof_damping[dof] + damping),
                "friction": _numbers(model.dof_frictionloss[dof]),
            }
            parts = [element("axis", xyz=_numbers(*axis))]
            parts += [element("limit", **limits)] if limits else []
            parts += [element("dynamics", **friction)]
            armature += model.dof_armature[dof]
            beyond = {"armature": _numbers(armature), "rest": _numbers(self.home[place])}
        for key, reasons in (("tied", self.tied), ("beyond", self.extra)):
            if index in reasons:
                beyond[key] = reasons[index]
        parts += [_origin(placement), element(EXTENSION, **beyond)]
        return _joint(self._name(index), urdf_type, carrier, child, *parts), anchor

    def _motor(self, index: int) -> tuple[float, float, float]:
        """Largest torque of the joint's actuators, their armature and damping at the joint."""
        model = self.model
        effort = float(np.abs(model.jnt_actfrcrange[index]).max())
        effort = effort if model.jnt_actfrclimited[index] else np.inf
        beyond = {"armature": 0.0, "damping": 0.0}
        driven = model.actuator_trntype == self.mujoco.mjtTrn.mjTRN_JOINT
        for actuator in np.flatnonzero(driven & (model.actuator_trnid[:, 0] == index)):
            gear = float(model.actuator_gear[actuator, 0])
            if model.actuator_forcelimited[actuator]:
                largest = float(np.abs(model.actuator_forcerange[actuator]).max())
                effort = min(effort, abs(gear) * largest)
            # Not every version of MuJoCo has these.
            for key in ("armature", "damping"):
                values = getattr(model, f"actuator_{key}", np.zeros(model.nu))
                beyond[key] += gear**2 * float(np.ravel(values[actuator])[0])
        return effort, beyond["armature"], beyond["damping"]


def element(tag: str, /, *children: Element, **attributes: str) -> Element:
    """Return a new element of XML with its content."""
    made = Element(tag, attributes)
    made.extend(children)
    return made


def _joint(name: str, urdf_type: str, parent: str, child: str, *parts: Element) -> Element:
    ends = element("parent", link=parent), element("child", link=child)
    return element("joint", *ends, *parts, name=name, type=urdf_type)


def joint_motion(urdf_type: str, axis: FloatArray, position: float) -> pin.SE3:
    """Placement behind a joint at a position, in the frame before it."""
    unit = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    if urdf_type == "prismatic":
        return pin.SE3(np.eye(3), unit * position)
    return pin.SE3(np.asarray(pin.AngleAxis(position, unit).toRotationMatrix()), np.zeros(3))


def _placement(position: FloatArray, quaternion: FloatArray) -> pin.SE3:
    w, x, y, z = (float(component) for component in quaternion)
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().matrix(), np.array(position))


def _origin(placement: pin.SE3) -> Element:
    angles = pin.rpy.matrixToRpy(placement.rotation)
    return element("origin", xyz=_numbers(*placement.translation), rpy=_numbers(*angles))


def _inertial(model: Any, body: int, anchor: FloatArray) -> Iterator[Element]:
    """The inertial of a body that has mass."""
    if model.body_mass[body] > 0.0:
        turned = _placement(np.zeros(3), model.body_iquat[body]).rotation
        inertia = turned @ np.diag(model.body_inertia[body]) @ turned.T
        names = {(i, j): f"i{'xyz'[i]}{'xyz'[j]}" for i in range(3) for j in range(i, 3)}
        yield element(
            "inertial",
            element("origin", xyz=_numbers(*model.body_ipos[body] - anchor)),
            element("mass", value=_numbers(model.body_mass[body])),
            element("inertia", **{name: _numbers(inertia[ij]) for ij, name in names.items()}),
        )


def _numbers(*values: Any) -> str:
    """All digits, and so many of them that no reader takes an angle for one that was rounded."""
    return " ".join(f"{float(value):.17e}" for value in values)
