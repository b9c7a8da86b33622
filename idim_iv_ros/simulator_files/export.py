"""From a result to the files of a simulator: the whole of `idim-iv export`."""

import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.effects.registry import name_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import EFFECTS, FilePath, complete_files, made_folder
from idim_iv_ros.model import read_urdf_file, read_urdf_text
from idim_iv_ros.model.mjcf import mjcf_as_urdf
from idim_iv_ros.model.urdf_reader import decoded_urdf, description_key
from idim_iv_ros.simulator_files.answer import Answer, read_answer
from idim_iv_ros.simulator_files.changes import changes_text
from idim_iv_ros.simulator_files.findings import (
    ISAAC_LAB,
    Exported,
    Findings,
    Texts,
    require_read_back,
)
from idim_iv_ros.simulator_files.isaac_lab import isaac_lab_text
from idim_iv_ros.simulator_files.law import DriveLaw, drive_law
from idim_iv_ros.simulator_files.links import LinkBody, body_of_joint, link_bodies
from idim_iv_ros.simulator_files.mjcf import JointValues, mjcf_text
from idim_iv_ros.simulator_files.mjcf_effects import Coupled, native_effects
from idim_iv_ros.simulator_files.mjcf_values import with_mjcf_values
from idim_iv_ros.simulator_files.randomization import EVENTS, RANDOMIZE
from idim_iv_ros.simulator_files.shared_friction import below_zero
from idim_iv_ros.simulator_files.urdf_text import with_values
from idim_iv_ros.simulators.effects_file import EffectsFile, PlantedEffect
from idim_iv_ros.types import FloatArray

CHANGES = "changes.md"


def export(
    result: FilePath,
    configuration: Configuration,
    out: FilePath,
    *,
    force: bool = False,
    refit: bool = False,
    without: Collection[str] = (),
    remainder: bool = False,
    randomize: bool = False,
) -> Exported:
    """Write a result as URDF, MJCF, effects, actuators of Isaac Lab and a table of changes.

    Of a diagnosis these are the nominal model and the named causes, a payload as a body of its own;
    of an identification its physical parameters.

    All files appear together, or none does; none takes the place of the file that was read. Where
    the nominal model is an MJCF, that file is kept, with other values in it.

    Parameters
    ----------
    result
        A result.json or gap.json.
    configuration
        That of the robot, with the URDF or MJCF that the result was made with.
    out
        Folder; created if it does not exist.
    force
        Replace files there that an export did not write.
    refit
        Write the physical parameters of a diagnosis, too, which hold what it does not name.
    without
        Causes that are left out: names of effects, or ``effect@joint``.
    remainder
        Spread what no cause explains over links and joints as far as the recording asks for it.
    randomize
        The same, and files that draw other robots which the recording cannot tell from this one.

    Returns
    -------
    Exported

    Raises
    ------
    UsageError
        The result is not of this robot and URDF, holds an effect that this version does not know,
        or not the cause that is left out; the files cannot be written.
    """
    path, out = Path(result), Path(out)
    source = configuration.robot.description
    if source is None:
        raise UsageError(
            f"{configuration.source or 'configuration'}: robot.urdf is not given: there is no file "
            "whose values could be changed; save the robot description as a URDF first"
        )
    text = read_urdf_file(source)
    content = source.read_bytes()
    answer = read_answer(
        path,
        configuration,
        text,
        str(source),
        refit=refit,
        without=without,
        remainder=remainder or randomize,
    )
    urdf = read_urdf_text(text, str(source))
    kept = description_key(source) == "mjcf"
    made = _files(source, out, answer, kept=kept, randomize=randomize)
    _require_other_files(made, source, path, configuration, force)
    robot = answer.robot
    bodies = {name: body_of_joint(answer.values, joint) for joint, name in enumerate(robot.joints)}
    links, notes = link_bodies(urdf, bodies, str(source))
    drives = _joint_values(answer, bodies)
    law = drive_law(configuration.controller, robot.joints, answer.effects)
    negative = below_zero(answer.values, robot.joints)
    notes += tuple(
        f"friction of {each.joint} below zero, which another effect there makes up for, is the "
        f"{each.effect} with parameters {each.parameters}: the file holds zero in its place"
        for each in negative
    )
    constant = tuple(
        PlantedEffect(name_of("offset"), name, None, {"offset": float(offset)})
        for name, offset in zip(robot.joints, drives.offset, strict=True)
        if offset
    )
    planted = (*answer.effects, *negative, *constant)
    what = Findings(
        answer, source, content, urdf, bodies, links, drives, law, planted, notes, kept, randomize
    )
    write = _from_mjcf if kept else _from_urdf
    texts, effects, notes = write(made, what, configuration)
    document = EffectsFile(
        base_parameters={} if kept else _base_of_couplings(answer),
        effects=effects,
        recordings=answer.bags,
    )
    names, kind = [file.name for file in made.files], "MJCF" if kept else "URDF"
    texts[made.effects] = document.to_json().encode()
    texts[made.changes] = changes_text(
        answer, effects, law, names, notes, randomization=what.randomization, file=kind
    ).encode()
    if what.randomization is not None:
        code = (
            what.randomization.mujoco_text(made.mjcf.name, what.origin),
            what.randomization.isaac_lab_text(what.origin),
        )
        texts |= {file: text.encode() for file, text in zip(made.ranges, code, strict=True)}
    _write(texts, out)
    missing = tuple(
        f"{effect.effect} at {effect.joint}" if effect.joint else effect.effect
        for effect in effects
        if not effect.native
    )
    return replace(made, not_native=missing, notes=(*answer.notes, *notes))


def _files(source: Path, out: Path, answer: Answer, *, kept: bool, randomize: bool) -> Exported:
    return Exported(
        urdf=None if kept else out / f"{source.stem}.urdf",
        mjcf=out / f"{source.stem}.xml",
        effects=out / EFFECTS,
        isaac_lab=None if kept else out / ISAAC_LAB,
        changes=out / CHANGES,
        ranges=(out / RANDOMIZE, out / EVENTS) if randomize else (),
        not_native=(),
        notes=(),
        bags=answer.bags,
    )


def _from_urdf(made: Exported, what: Findings, configuration: Configuration) -> Texts:
    """Contents of all files; the MJCF is new, and holds what effects it can."""
    answer, drives, law, source = what.answer, what.drives, what.law, str(what.source)
    robot, notes = answer.robot, what.notes
    assert made.urdf is not None and made.isaac_lab is not None
    native, effects = native_effects(what.planted, robot, law)
    dynamics = {
        name: {"damping": float(drives.damping[joint]), "friction": float(drives.friction[joint])}
        for joint, name in enumerate(robot.joints)
    }
    written = with_values(what.content, what.links, dynamics, what.mounted, source)
    require_read_back(decoded_urdf(written), configuration, what)
    comments = _comments(what.origin, law, effects)
    if couplings := _base_of_couplings(answer):
        notes = (*notes, f"{', '.join(couplings)}: in {EFFECTS} and the MJCF; a URDF has no place")
    texts = {
        made.urdf: written,
        made.mjcf: mjcf_text(
            answer, what.urdf, drives, law, native, what.mounted, comments
        ).encode(),
        made.isaac_lab: isaac_lab_text(
            robot, made.urdf.name, drives, law, effects, what.origin
        ).encode(),
    }
    return texts, effects, notes


def _from_mjcf(made: Exported, what: Findings, configuration: Configuration) -> Texts:
    """Contents of all files; the MJCF is the user's, so that effects stay with the callbacks."""
    answer, source = what.answer, what.source
    if configuration.robot.couplings:
        raise UsageError(
            f"{configuration.source or 'configuration'}: robot.couplings: the coupled transmission "
            f"would be a tendon that {source} does not have: diagnose with the same robot as "
            "robot.urdf, whose export makes an MJCF with it"
        )
    written, more = with_mjcf_values(
        what.content,
        source,
        what.urdf,
        what.links,
        answer.robot.joints,
        what.drives,
        what.mounted,
    )
    require_read_back(mjcf_as_urdf(source, decoded_urdf(written)), configuration, what)
    notes = (
        *what.notes,
        *more,
        "everything else of the MJCF is as it was, actuators and time step too: they need not be "
        "the law of the configuration, which is in changes.md",
        "dry friction turns as early as in the recording, not 10 ms before the joint as with "
        "MuJoCo's default: that is solreffriction of the joints",
        f"there is no {ISAAC_LAB}: it needs a URDF",
    )
    if configuration.simulator.armature is not None:
        notes += ("the MJCF holds the armature now: leave out simulator.armature beside it",)
    return {made.mjcf: written}, what.planted, notes


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
            answer.values.get(f"Fvm{second + 1}", 0.0),
            answer.values.get(f"Fcm{second + 1}", 0.0),
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
        lead=np.array([answer.friction_leads.get(name, 0.0) for name in robot.joints]),
        couplings=couplings,
    )


def _base_of_couplings(answer: Answer) -> dict[str, float]:
    return {
        parameter.name: parameter.value
        for parameter in answer.parameters
        if parameter.name.startswith(("Fvm", "Fcm")) and parameter.value != parameter.given
    }


def _comments(origin: str, law: DriveLaw, effects: tuple[PlantedEffect, ...]) -> list[str]:
    lines = [f"From {origin} by idim_iv_ros; changes.md says what is new and how sure it is."]
    if law.in_actuators:
        lines.append(
            "Actuators are the law: ctrl of JOINT is q_ref"
            + (", of JOINT_velocity dq_ref." if law.velocity_reference else ".")
        )
    else:
        lines.append(f"Actuators are motors, ctrl is the torque of the law: {law.words}.")
    missing = [effect for effect in effects if not effect.native]
    if missing:
        names = ", ".join(f"{cause.effect} at {cause.joint}" for cause in missing)
        lines.append(f"Not in this file, but in effects.json for Effects: {names}.")
    return lines


def _write(contents: Mapping[Path, bytes], out: Path) -> None:
    """Write all files, or none, and no folder either."""
    try:
        with made_folder(out), complete_files(contents) as temporary:
            for path, content in contents.items():
                with temporary[path].open("wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"{out}: cannot be written: {reason}; give another --out") from error
