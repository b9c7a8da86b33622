"""Splice values into the bytes of the user's own MJCF: all else stays as it is.

What an `<inertial>` of the file is written as stays: `fullinertia` in the axes of the body, or
`diaginertia` with a `quat`. Attributes that a default class gives are written at the joint itself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from idim_iv_ros.errors import UsageError
from idim_iv_ros.model.mjcf import compiled_mjcf
from idim_iv_ros.model.mjcf_ties import native_elements
from idim_iv_ros.model.urdf import Urdf
from idim_iv_ros.simulator_files.links import LinkBody
from idim_iv_ros.simulator_files.mjcf import JointValues, friction_solver, inertial_of
from idim_iv_ros.simulator_files.mjcf_elements import Body, elements_of, with_included
from idim_iv_ros.simulator_files.named import Load
from idim_iv_ros.simulator_files.xml_edits import (
    Edits,
    Element,
    comment_text,
    number_text,
    numbers_text,
)
from idim_iv_ros.types import FloatArray

_TURNS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
_CHANGES_INERTIALS = ("balanceinertia", "fusestatic", "boundmass", "boundinertia", "settotalmass")
_DEFAULT_SOLVER = (0.02, 1.0)  # solreffriction of MuJoCo: another one is the user's
_NEAR = 0.1  # of it: known no better from a recording
# Of a sum that was taken apart again: what differs by less is rounding.
_ROUNDING = 1e-14


def with_mjcf_values(
    content: bytes,
    path: Path,
    urdf: Urdf,
    links: Mapping[str, LinkBody],
    joints: Sequence[str],
    values: JointValues,
    mounted: Mapping[str, tuple[str, Load]],
) -> tuple[bytes, tuple[str, ...]]:
    """Return the MJCF with other values and bodies for payloads, and what to say of it.

    Parameters
    ----------
    content
        The bytes of the file.
    path
    urdf
        What this program makes of the file.
    links
        Inertials of links in their frames, by name.
    joints
        Those that are identified, in the order of `values`.
    values
    mounted
        Payloads by the name of their body, each with the link that carries it.

    Raises
    ------
    UsageError
        The file takes bodies from an asset or makes them by itself, or has settings that change
        inertials; a joint or body whose values have no place of their own.
    """
    content, included = with_included(content, path)
    bodies, notes = elements_of(content, str(path))
    if included:
        notes += (f"what the MJCF includes ({', '.join(included)}) is written out in it",)
    mujoco, spec, model = compiled_mjcf(path)
    _require_own_inertials(mujoco, spec, model, str(path))
    file = _File(mujoco, model, bodies, Edits(content), str(path))
    for place, name in enumerate(joints):
        file.joint(urdf, name, values, place)
    new = [file.inertial(name, body) for name, body in links.items()]
    for name, (link, load) in mounted.items():
        file.payload(name, link, load)
    without = [name for name, was_there in zip(links, new, strict=True) if not was_there]
    if without:
        notes += (
            f"the inertia of {', '.join(without)} was that of geoms; it has an <inertial> now, so "
            "that the mass of its geoms no longer counts",
        )
    return file.edits.made(), notes


def _require_own_inertials(mujoco: Any, spec: Any, model: Any, source: str) -> None:
    """Refuse a file in which an `<inertial>` is not what MuJoCo takes."""
    always = int(mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE)
    found = ['inertiafromgeom="true"'] if int(spec.compiler.inertiafromgeom) == always else []
    # A version of MuJoCo need not have all of them.
    found += [name for name in _CHANGES_INERTIALS if getattr(spec.compiler, name, 0) > 0]
    if found:
        raise UsageError(
            f"{source}: <compiler> has {', '.join(found)}, so that the <inertial> of a body is not "
            "what is simulated: write the inertials out without it (`mj_saveLastXML` does)"
        )
    effects = [name for name, elements in native_elements(mujoco, model).items() if elements]
    if effects:
        raise UsageError(
            f"{source}: holds {', '.join(effects)} of an earlier export, which the new effects "
            "would count twice: export with the MJCF or URDF that was there before"
        )


@dataclass
class _File:
    mujoco: Any
    model: Any
    bodies: Mapping[str, Body]
    edits: Edits
    source: str

    def joint(self, urdf: Urdf, name: str, values: JointValues, place: int) -> None:
        """Armature, damping and friction at the joint, less what its actuators have of them."""
        given = urdf.joints[name]
        body, element = self._joint_element(given.child, name)
        index = int(self.model.body(body).jntadr[0])
        dof = int(self.model.jnt_dofadr[index])
        now = {
            "armature": float(self.model.dof_armature[dof]),
            "damping": float(np.ravel(self.model.dof_damping[dof])[0]),
            "frictionloss": float(self.model.dof_frictionloss[dof]),
        }
        # What the compiled joint has less than the nominal model is that of actuators.
        beyond = {
            "armature": given.armature - now["armature"],
            "damping": given.damping - now["damping"],
            "frictionloss": 0.0,
        }
        new = {
            "armature": float(values.armature[place]) - beyond["armature"],
            "damping": float(values.damping[place]) - beyond["damping"],
            "frictionloss": float(values.friction[place]),
        }
        for key, value in new.items():
            if value < -_ROUNDING * max(1.0, abs(beyond[key])):
                raise UsageError(
                    f"{self.source}: joint {name}: its actuators alone have more {key} "
                    f"({beyond[key]:.6g}) than was found ({value + beyond[key]:.6g}): take it out "
                    "of the actuators"
                )
        changed = {
            key: number_text(max(value, 0.0))
            for key, value in new.items()
            if abs(value - now[key]) > _ROUNDING * (abs(now[key]) + abs(beyond[key]))
        }
        solver = friction_solver(float(values.lead[place]), float(self.model.opt.timestep))
        constant, ratio = self.model.dof_solref[dof]
        own = (constant, ratio) != _DEFAULT_SOLVER
        near = abs(float(solver["solreffriction"].split()[0]) / constant - 1.0) < _NEAR
        if new["frictionloss"] > 0.0 and not own and not near:
            changed |= solver
        self.edits.set(element, changed, zeros=True)

    def _joint_element(self, link: str, name: str) -> tuple[str, Element]:
        for body_name, body in self.bodies.items():
            if name in body.named_joints and len(body.joints) > 1:
                raise UsageError(
                    f"{self.source}: body {body_name} has {len(body.joints)} joints, and one "
                    f"<inertial> cannot hold what each of them carries: give {name} a body of its "
                    "own"
                )
        body = self._body(link)
        if len(body.joints) != 1:
            raise UsageError(
                f"{self.source}: body {link} has {len(body.joints)} joints, and one <inertial> "
                f"cannot hold what each of them carries: give {name} a body of its own"
            )
        return link, body.joints[0]

    def _body(self, link: str) -> Body:
        if link not in self.bodies:
            raise UsageError(
                f"{self.source}: {link} is no named <body> of this file: give each body that "
                "moves a name and one joint"
            )
        return self.bodies[link]

    def inertial(self, link: str, new: LinkBody) -> bool:
        """Write the inertial of a link; False where the body had none."""
        body = self._body(link)
        values = inertial_of(new, self._anchor(link))
        element = body.inertial
        if element is None:
            self.edits.first_child(body.element, [_inertial_text(values)])
            return False
        present = self.edits.attributes(element)
        full = {"fullinertia": values.pop("fullinertia")}
        self.edits.set(element, values, zeros=True)
        if "diaginertia" not in present:
            self.edits.set(element, full)
            return True
        index = self.model.body(link).id
        w, x, y, z = (float(component) for component in self.model.body_iquat[index])
        moments, quaternion = _principal(new.inertia, pin.Quaternion(w, x, y, z).matrix())
        self.edits.set(element, {"diaginertia": numbers_text(moments)})
        turn = next((key for key in _TURNS if key in present), "quat")
        if turn == "quat":
            self.edits.set(element, {"quat": numbers_text(quaternion)})
        else:
            self.edits.rename(element, turn, "quat", numbers_text(quaternion))
        return True

    def payload(self, name: str, link: str, load: Load) -> None:
        """A body of its own within the one that carries it."""
        anchor = numbers_text(self._anchor(link))
        lines = [
            f"<!-- {comment_text(load.words)} -->",
            f'<body name={quoteattr(name)} pos="{anchor}">',
            f"  {_inertial_text(inertial_of(load.body))}",
            "</body>",
        ]
        self.edits.first_child(self._body(link).element, lines)

    def _anchor(self, link: str) -> FloatArray:
        """From the frame of a body to that of its link, m, as `mjcf_as_urdf` places it."""
        body, types = self.model.body(link), self.mujoco.mjtJoint
        if body.jntnum[0] == 0:
            return np.zeros(3)
        last = int(body.jntadr[0] + body.jntnum[0]) - 1
        if int(self.model.jnt_type[last]) not in (int(types.mjJNT_HINGE), int(types.mjJNT_SLIDE)):
            return np.zeros(3)
        return np.array(self.model.jnt_pos[last])


def _inertial_text(values: Mapping[str, str]) -> str:
    return f"<inertial {' '.join(f'{key}={quoteattr(text)}' for key, text in values.items())}/>"


def _principal(inertia: FloatArray, before: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return principal moments (3,) and the quaternion (4,) of their axes, w first.

    In the order and with the signs that are nearest to the axes `before` (3, 3), so that small
    changes of a body are small changes of its numbers.
    """
    moments, axes = np.linalg.eigh(inertia)
    overlap = np.abs(before.T @ axes)
    order = max(permutations(range(3)), key=lambda each: overlap[range(3), each].sum())
    moments, axes = moments[list(order)], axes[:, list(order)]
    along = np.diag(before.T @ axes)
    axes = axes * np.where(along < 0.0, -1.0, 1.0)
    if np.linalg.det(axes) < 0.0:
        axes[:, int(np.argmin(np.abs(along)))] *= -1.0
    turn = pin.Quaternion(axes)
    return moments, np.array([turn.w, turn.x, turn.y, turn.z])
