"""From a result to the files of a simulator: the whole of `idim-iv export`."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import EFFECTS, FilePath, complete_files
from idim_iv_ros.model import load_robot, read_urdf_file, read_urdf_text
from idim_iv_ros.model.parameters import REGRESSOR_ORDER
from idim_iv_ros.model.urdf import Urdf
from idim_iv_ros.model.urdf_reader import decoded_urdf
from idim_iv_ros.simulator_files.answer import Answer, read_answer
from idim_iv_ros.simulator_files.changes import ChangedLink, changes_text, simulator_lines
from idim_iv_ros.simulator_files.isaac_lab import isaac_lab_text
from idim_iv_ros.simulator_files.law import DriveLaw, drive_law
from idim_iv_ros.simulator_files.links import LinkBody, body_of_joint, link_bodies
from idim_iv_ros.simulator_files.mjcf import JointValues, mjcf_text
from idim_iv_ros.simulator_files.mjcf_effects import Coupled, native_effects
from idim_iv_ros.simulator_files.shared_friction import below_zero
from idim_iv_ros.simulator_files.urdf_text import MOMENTS, with_values
from idim_iv_ros.simulators.effects_file import EffectsFile, PlantedEffect
from idim_iv_ros.types import FloatArray

ISAAC_LAB, CHANGES = "isaac_lab.py", "changes.md"
_READ_BACK = 1e-9  # of the largest parameter of its kind


@dataclass(frozen=True)
class Exported:
    """Files that were written, and what a user must know of them.

    Attributes
    ----------
    urdf, mjcf, values, effects, isaac_lab, changes : Path
    not_native : tuple of str
        Effects that MuJoCo has no element for.
    notes : tuple of str
    bags : tuple of str
        Names of the recordings that the result is from.
    """

    urdf: Path
    mjcf: Path
    values: Path
    effects: Path
    isaac_lab: Path
    changes: Path
    not_native: tuple[str, ...]
    notes: tuple[str, ...]
    bags: tuple[str, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All of them."""
        return (self.urdf, self.mjcf, self.values, self.effects, self.isaac_lab, self.changes)


def export(
    result: FilePath, configuration: Configuration, out: FilePath, *, force: bool = False
) -> Exported:
    """Write a result as URDF, MJCF, effects, actuators of Isaac Lab and a table of changes.

    All files appear together, or none does; none takes the place of the URDF that was read.

    Parameters
    ----------
    result
        A result.json or gap.json.
    configuration
        That of the robot, with the URDF that the result was made with.
    out
        Folder; created if it does not exist.
    force
        Replace files there that an export did not write.

    Returns
    -------
    Exported

    Raises
    ------
    UsageError
        The result is not of this robot and URDF, holds an effect that this version does not know,
        or the files cannot be written.
    """
    path, out = Path(result), Path(out)
    source = configuration.robot.urdf
    if configuration.robot.mjcf is not None:
        raise UsageError(
            f"{configuration.source or 'configuration'}: robot.mjcf is the nominal model, and an "
            "export changes values of a URDF: diagnose with the same robot as robot.urdf, or "
            "replay this result as it is: `idim-iv replay BAG --effects gap.json`"
        )
    if source is None:
        raise UsageError(
            f"{configuration.source or 'configuration'}: robot.urdf is not given: there is no file "
            "whose values could be changed; save the robot description as a URDF first"
        )
    text = read_urdf_file(source)
    content = source.read_bytes()
    answer = read_answer(path, configuration, text, str(source))
    urdf = read_urdf_text(text, str(source))
    made = Exported(
        urdf=out / f"{source.stem}.urdf",
        mjcf=out / f"{source.stem}.xml",
        values=out / f"{source.stem}.values.yaml",
        effects=out / EFFECTS,
        isaac_lab=out / ISAAC_LAB,
        changes=out / CHANGES,
        not_native=(),
        notes=(),
        bags=answer.bags,
    )
    _require_other_files(made, source, path, configuration, force)
    robot = answer.robot
    bodies = {
        name: body_of_joint(answer.physical.values, joint)
        for joint, name in enumerate(robot.joints)
    }
    links, notes = link_bodies(urdf, bodies, str(source))
    drives = _joint_values(answer, bodies)
    law = drive_law(configuration.controller, robot.joints, answer.effects)
    negative = below_zero(answer.physical, robot.joints)
    notes += tuple(
        f"friction of {each.joint} below zero, which another effect there makes up for, is the "
        f"{each.effect} with parameters {each.parameters}: a URDF holds zero in its place"
        for each in negative
    )
    constant = tuple(
        PlantedEffect("torque_offset", name, None, {"offset": float(offset)})
        for name, offset in zip(robot.joints, drives.offset, strict=True)
        if offset
    )
    planted = (*answer.effects, *negative, *constant)
    native, effects = native_effects(planted, robot, law)
    dynamics = {
        name: {"damping": float(drives.damping[joint]), "friction": float(drives.friction[joint])}
        for joint, name in enumerate(robot.joints)
    }
    written = with_values(content, links, dynamics, str(source))
    _require_read_back(written, configuration, drives, bodies, str(source))
    origin = f"{path.name} ({'diagnosis' if answer.diagnosed else 'identification'})"
    comments = _comments(origin, law, effects)
    changed = [ChangedLink(name, _given(urdf, name), body) for name, body in links.items()]
    names = [file.name for file in made.files]
    if couplings := _base_of_couplings(answer):
        notes = (*notes, f"{', '.join(couplings)}: in {EFFECTS} and the MJCF; a URDF has no place")
    texts = {
        made.urdf: written,
        made.mjcf: mjcf_text(robot, urdf, drives, law, native, comments).encode(),
        made.values: _overlay(answer, links, dynamics, origin).encode(),
        made.effects: EffectsFile(base_parameters=couplings, effects=effects).to_json().encode(),
        made.isaac_lab: isaac_lab_text(
            robot, made.urdf.name, drives, law, effects, origin
        ).encode(),
        made.changes: changes_text(answer, changed, effects, law, names, notes).encode(),
    }
    _write(texts, out)
    missing = tuple(
        f"{each.effect} at {each.joint}" if each.joint else each.effect
        for each in effects
        if not each.native
    )
    return replace(made, not_native=missing, notes=(*answer.notes, *notes))


def _require_other_files(
    made: Exported, source: Path, result: Path, configuration: Configuration, force: bool
) -> None:
    """Refuse to write over what was read, or over files that are no export."""
    read = [source, result, *([configuration.source] if configuration.source else [])]
    for file in made.files:
        if any(file.exists() and file.samefile(other) for other in read):
            raise UsageError(f"{file}: was read for this export; give another --out")
    before = made.effects.is_file() and made.changes.is_file()
    for file in made.files:
        if file.exists() and not force and not before:
            raise UsageError(
                f"{file}: exists, and is not of an earlier export; give another --out, or --force "
                "to replace it"
            )


def _joint_values(answer: Answer, bodies: Mapping[str, FloatArray]) -> JointValues:
    robot = answer.robot
    joints = range(len(robot.joints))
    numbers = {
        kind: np.array([answer.value(kind, joint, float(given[joint])) for joint in joints])
        for kind, given in robot.given.of_drives.items()
    }
    couplings = tuple(
        Coupled(
            int(first),
            int(second),
            1.0,
            answer.physical.values.get(f"Fvm{second + 1}", 0.0),
            answer.physical.values.get(f"Fcm{second + 1}", 0.0),
            float(numbers["Ia"][second]),
        )
        for first, second in robot.given.coupling_joints
    )
    return JointValues(
        armature=numbers["Ia"],
        damping=np.maximum(numbers["Fv"], 0.0),
        friction=np.maximum(numbers["Fc"], 0.0),
        offset=numbers["off"],
        bodies=tuple(LinkBody.of(bodies[name]) for name in robot.joints),
        couplings=couplings,
    )


def _base_of_couplings(answer: Answer) -> dict[str, float]:
    return {
        each.name: each.value
        for each in answer.physical.parameters
        if each.name.startswith(("Fvm", "Fcm"))
    }


def _given(urdf: Urdf, link: str) -> LinkBody | None:
    inertial = urdf.links[link]
    if inertial is None:
        return None
    return LinkBody(inertial.mass, inertial.centre, inertial.inertia)


def _require_read_back(
    written: bytes,
    configuration: Configuration,
    drives: JointValues,
    bodies: Mapping[str, FloatArray],
    source: str,
) -> None:
    """Read the new URDF as this program reads any, and find the parameters that were meant."""
    robot = load_robot(decoded_urdf(written), configuration.robot.joints, source=source)
    meant = np.array(list(bodies.values()))
    found = robot.given.inertial[:, list(REGRESSOR_ORDER)]
    same = np.allclose(found, meant, rtol=0.0, atol=_READ_BACK * np.abs(meant).max())
    same &= np.allclose(robot.given.viscous, drives.damping, rtol=_READ_BACK)
    same &= np.allclose(robot.given.coulomb, drives.friction, rtol=_READ_BACK)
    if not same:
        raise UsageError(
            f"{source}: values were put in, and others are read back: elements are written in a "
            "way that this program does not know; nothing was written"
        )


def _comments(origin: str, law: DriveLaw, effects: tuple[PlantedEffect, ...]) -> list[str]:
    lines = [f"From {origin} by idim_iv_ros; changes.md says what is new and how sure it is."]
    if law.in_actuators:
        lines.append(
            "Actuators are the law: ctrl of JOINT is q_ref"
            + (", of JOINT_velocity dq_ref." if law.velocity_reference else ".")
        )
    else:
        lines.append(f"Actuators are motors, ctrl is the torque of the law: {law.words}.")
    missing = [each for each in effects if not each.native]
    if missing:
        names = ", ".join(f"{each.effect} at {each.joint}" for each in missing)
        lines.append(f"Not in this file, but in effects.json for Effects: {names}.")
    return lines


def _overlay(
    answer: Answer,
    links: Mapping[str, LinkBody],
    dynamics: Mapping[str, Mapping[str, float]],
    origin: str,
) -> str:
    """Values by link and joint, for a description that is made by macros."""
    lines = [f"# From {origin} by idim_iv_ros, for descriptions that macros make.", "links:"]
    for name, body in links.items():
        inertia = body.inertia
        lines += [
            f"  {name}:",
            f"    mass: {body.mass!r}   # kg",
            f"    origin: {{xyz: [{', '.join(repr(float(v)) for v in body.centre)}], "
            "rpy: [0.0, 0.0, 0.0]}   # m, rad",
            "    inertia: {"
            + ", ".join(f"{key}: {float(inertia[place])!r}" for key, place in MOMENTS.items())
            + "}   # kg m²",
        ]
    lines.append("joints:")
    for name, values in dynamics.items():
        listed = ", ".join(f"{key}: {value!r}" for key, value in values.items())
        lines.append(f"  {name}: {{{listed}}}   # N m s/rad, N m")
    return "\n".join([*lines, *simulator_lines(answer)]) + "\n"


def _write(contents: Mapping[Path, bytes], out: Path) -> None:
    """Write all files, or none, and no folder either."""
    missing = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
        with complete_files(contents) as temporary:
            for path, content in contents.items():
                with temporary[path].open("wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
    except OSError as error:
        for folder in missing:
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()
        reason = error.strerror or error
        raise UsageError(f"{out}: cannot be written: {reason}; give another --out") from error
