"""From a result to the files of a simulator: the whole of `idim-iv export`."""

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.effects.registry import STRUCTURAL, name_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import EFFECTS, FilePath, complete_files, made_folder
from idim_iv_ros.model import kinematics_digest, load_robot, read_urdf_file, read_urdf_text
from idim_iv_ros.model.mjcf import mjcf_as_urdf
from idim_iv_ros.model.parameters import REGRESSOR_ORDER
from idim_iv_ros.model.urdf import Urdf
from idim_iv_ros.model.urdf_reader import decoded_urdf, description_key
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.answer import Answer, read_answer
from idim_iv_ros.simulator_files.changes import changes_text
from idim_iv_ros.simulator_files.isaac_lab import isaac_lab_text
from idim_iv_ros.simulator_files.law import DriveLaw, drive_law
from idim_iv_ros.simulator_files.links import LinkBody, body_of_joint, link_bodies
from idim_iv_ros.simulator_files.mjcf import JointValues, mjcf_text
from idim_iv_ros.simulator_files.mjcf_effects import Coupled, native_effects
from idim_iv_ros.simulator_files.mjcf_kept import with_mjcf_values
from idim_iv_ros.simulator_files.named import Load
from idim_iv_ros.simulator_files.randomization import EVENTS, RANDOMIZE, Randomization
from idim_iv_ros.simulator_files.urdf_text import with_values
from idim_iv_ros.simulators.effects_file import EffectsFile
from idim_iv_ros.types import FloatArray

CHANGES, ISAAC_LAB = "changes.md", "isaac_lab.py"
_READ_BACK = 1e-6  # of the largest parameter of its kind: digits of a file


@dataclass(frozen=True)
class Exported:
    """Files that were written, and what a user must know of them.

    Attributes
    ----------
    urdf, mjcf, effects, isaac_lab, changes : Path
        Where the nominal model is an MJCF, `urdf` and `isaac_lab` are None.
    ranges : tuple of Path
        What draws other robots, for MuJoCo and for Isaac Lab; empty where that was not asked for.
    not_native : tuple of str
        Effects that MuJoCo has no element for.
    notes : tuple of str
    bags : tuple of str
        Names of the recordings that the result is from.
    """

    urdf: Path | None
    mjcf: Path
    effects: Path
    isaac_lab: Path | None
    changes: Path
    ranges: tuple[Path, ...]
    not_native: tuple[str, ...]
    notes: tuple[str, ...]
    bags: tuple[str, ...]

    @property
    def files(self) -> tuple[Path, ...]:
        """All of them."""
        files = (self.urdf, self.mjcf, self.effects, self.isaac_lab, self.changes, *self.ranges)
        return tuple(file for file in files if file is not None)


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
    answer = read_answer(
        path,
        configuration,
        text,
        str(source),
        refit=refit,
        without=without,
        remainder=remainder or randomize,
    )
    of_mjcf = description_key(source) == "mjcf"
    made = Exported(
        urdf=None if of_mjcf else out / f"{source.stem}.urdf",
        mjcf=out / f"{source.stem}.xml",
        effects=out / EFFECTS,
        isaac_lab=None if of_mjcf else out / ISAAC_LAB,
        changes=out / CHANGES,
        ranges=(out / RANDOMIZE, out / EVENTS) if randomize else (),
        not_native=(),
        notes=(),
        bags=answer.bags,
    )
    _require_other_files(made, source, path, configuration, force)
    urdf = read_urdf_text(text, str(source))
    robot = _ExportedRobot(answer, configuration, source, source.read_bytes(), urdf)
    texts, effects, more = robot.of_mjcf(made) if of_mjcf else robot.of_urdf(made)
    notes = (*robot.notes, *more)
    document = EffectsFile(
        base_parameters={} if of_mjcf else robot.coupled_friction,
        effects=effects,
        recordings=answer.bags,
    )
    ranges = robot.randomization if randomize else None
    names, kind = [file.name for file in made.files], "MJCF" if of_mjcf else "URDF"
    texts[made.effects] = document.to_json()
    texts[made.changes] = changes_text(
        answer, effects, robot.law, names, notes, randomization=ranges, file=kind
    )
    if ranges is not None:
        of_mujoco, of_isaac_lab = made.ranges
        texts[of_mujoco] = ranges.mujoco_text(made.mjcf.name, robot.origin)
        texts[of_isaac_lab] = ranges.isaac_lab_text(robot.origin)
    _write(texts, out)
    return replace(
        made,
        not_native=tuple(
            f"{effect.effect} at {effect.joint}" if effect.joint else effect.effect
            for effect in effects
            if not effect.native
        ),
        notes=(*answer.notes, *notes),
    )


# Contents by file, effects marked as native or not, and notes.
_Made = tuple[dict[Path, bytes | str], tuple[SimulatedEffect, ...], tuple[str, ...]]


@dataclass(frozen=True)
class _ExportedRobot:
    """An answer, the file that it changes, and what follows from both for all written files."""

    answer: Answer
    configuration: Configuration
    source: Path
    content: bytes
    urdf: Urdf

    @property
    def origin(self) -> str:
        """What the numbers come from."""
        kind = "diagnosis" if self.answer.diagnosed else "identification"
        return f"{self.answer.path.name} ({kind})"

    @cached_property
    def bodies(self) -> dict[str, FloatArray]:
        """XX … M (10,) of what each joint carries, without payloads."""
        joints, values = self.answer.robot.joints, self.answer.model.values
        return {name: body_of_joint(values, joint) for joint, name in enumerate(joints)}

    @cached_property
    def links(self) -> tuple[dict[str, LinkBody], tuple[str, ...]]:
        """Links that change, and what there is to say of them."""
        return link_bodies(self.urdf, self.bodies, str(self.source))

    @cached_property
    def mounted(self) -> dict[str, tuple[str, Load]]:
        """Payloads by a link name that no link has, each with the link that carries it."""
        taken, mounted = set(self.urdf.links), {}
        for load in self.answer.model.loads:
            name = load.name
            while name in taken:
                name += "_found"
            taken.add(name)
            mounted[name] = (self.urdf.joints[load.joint].child, load)
        return mounted

    @cached_property
    def drives(self) -> JointValues:
        """Drives and friction of all joints."""
        robot, values = self.answer.robot, self.answer.model.values
        numbers = {
            kind: np.array(self.answer.values(kind, given))
            for kind, given in robot.given.of_drives.items()
        }
        leads = self.answer.friction_leads
        return JointValues(
            armature=numbers["Ia"],
            damping=np.maximum(numbers["Fv"], 0.0),
            friction=np.maximum(numbers["Fc"], 0.0),
            offset=numbers["off"],
            bodies=tuple(LinkBody.of(body) for body in self.bodies.values()),
            lead=np.array([leads.get(name, 0.0) for name in robot.joints]),
            couplings=tuple(
                Coupled(
                    int(first),
                    int(second),
                    1.0,
                    values.get(f"Fvm{second + 1}", 0.0),
                    values.get(f"Fcm{second + 1}", 0.0),
                    float(numbers["Ia"][second]),
                )
                for first, second in robot.given.coupling_joints
            ),
        )

    @cached_property
    def negative_friction(self) -> tuple[SimulatedEffect, ...]:
        """Fv and Fc below zero as effects that are the same torque (`Cause.instead_of`).

        No simulator has it as a number: the sum of a joint's friction is simulated, and kept from
        driving.
        """
        values = self.answer.model.values
        return tuple(
            SimulatedEffect(effect.name, name, numbers)
            for joint, name in enumerate(self.answer.robot.joints, 1)
            for kind in ("Fv", "Fc")
            if values.get(f"{kind}{joint}", 0.0) < 0.0
            for effect in STRUCTURAL
            if (numbers := effect.instead_of(kind, values[f"{kind}{joint}"]))
        )

    @property
    def effects(self) -> tuple[SimulatedEffect, ...]:
        """All effects, with negative friction and constant torques among them."""
        offsets = zip(self.answer.robot.joints, self.drives.offset, strict=True)
        constant = tuple(
            SimulatedEffect(name_of("offset"), name, {"offset": float(offset)})
            for name, offset in offsets
            if offset
        )
        return (*self.answer.effects, *self.negative_friction, *constant)

    @cached_property
    def law(self) -> DriveLaw:
        """The configured law as the robot runs it."""
        return drive_law(
            self.configuration.controller, self.answer.robot.joints, self.answer.effects
        )

    @property
    def coupled_friction(self) -> dict[str, float]:
        """Friction of coupled transmissions, which no URDF has."""
        return {
            parameter.name: parameter.value
            for parameter in self.answer.model.parameters
            if parameter.name.startswith(("Fvm", "Fcm")) and parameter.value != parameter.given
        }

    @property
    def notes(self) -> tuple[str, ...]:
        """What there is to say of links and friction."""
        negative = tuple(
            f"friction of {effect.joint} below zero, which another effect there makes up for, is "
            f"the {effect.effect} with parameters {effect.parameters}: the file holds zero in its "
            "place"
            for effect in self.negative_friction
        )
        return (*self.links[1], *negative)

    @property
    def randomization(self) -> Randomization | None:
        """What may vary; None where nothing is spread."""
        if self.answer.model.remainder is None:
            return None
        links = {name: self.urdf.joints[name].child for name in self.answer.robot.joints}
        loads = {load.name: name for name, (_, load) in self.mounted.items()}
        return Randomization.of(self.answer, self.answer.model.remainder, links, loads)

    def of_urdf(self, made: Exported) -> _Made:
        """Write a URDF and what goes with it; the MJCF is new, and holds what effects it can."""
        answer, drives, law = self.answer, self.drives, self.law
        assert made.urdf is not None and made.isaac_lab is not None
        native, effects = native_effects(self.effects, answer.robot, law)
        dynamics = {
            name: {"damping": float(damping), "friction": float(friction)}
            for name, damping, friction in zip(
                answer.robot.joints, drives.damping, drives.friction, strict=True
            )
        }
        written = with_values(self.content, self.links[0], dynamics, self.mounted, str(self.source))
        self._require_read_back(decoded_urdf(written))
        comments = _comments(self.origin, law, effects)
        texts: dict[Path, bytes | str] = {
            made.urdf: written,
            made.mjcf: mjcf_text(answer, self.urdf, drives, law, native, self.mounted, comments),
            made.isaac_lab: isaac_lab_text(
                answer.robot, made.urdf.name, drives, law, effects, self.origin
            ),
        }
        names = ", ".join(self.coupled_friction)
        notes = (f"{names}: in {EFFECTS} and the MJCF; a URDF has no place",) if names else ()
        return texts, effects, notes

    def of_mjcf(self, made: Exported) -> _Made:
        """Write the user's MJCF; effects stay with the callbacks."""
        if self.configuration.robot.couplings:
            raise UsageError(
                f"{self.configuration.source or 'configuration'}: robot.couplings: the coupled "
                f"transmission would be a tendon that {self.source} does not have: diagnose with "
                "the same robot as robot.urdf, whose export makes an MJCF with it"
            )
        written, notes = with_mjcf_values(
            self.content,
            self.source,
            self.urdf,
            self.links[0],
            self.answer.robot.joints,
            self.drives,
            self.mounted,
        )
        self._require_read_back(mjcf_as_urdf(self.source, decoded_urdf(written)), armature=True)
        notes += (
            "everything else of the MJCF is as it was, actuators and time step too: they need not "
            "be the law of the configuration, which is in changes.md",
            "dry friction turns as early as in the recording, not 10 ms before the joint as with "
            "MuJoCo's default: that is solreffriction of the joints",
            f"there is no {ISAAC_LAB}: it needs a URDF",
        )
        if self.configuration.simulator.armature is not None:
            notes += ("the MJCF holds the armature now: leave out simulator.armature beside it",)
        return {made.mjcf: written}, self.effects, notes

    def _require_read_back(self, text: str, *, armature: bool = False) -> None:
        """Read the new file as this program reads any, and find the parameters that were meant."""
        joints, drives = self.configuration.robot.joints, self.drives
        robot = load_robot(text, joints, source=str(self.source))
        meant = np.array(list(self.bodies.values()))
        for load in self.answer.model.loads:
            meant[list(self.bodies).index(load.joint)] += load.parameters
        inertial = robot.given.inertial[:, list(REGRESSOR_ORDER)]
        same = np.allclose(inertial, meant, rtol=0.0, atol=_READ_BACK * np.abs(meant).max())
        same &= np.allclose(robot.given.viscous, drives.damping, rtol=_READ_BACK)
        same &= np.allclose(robot.given.coulomb, drives.friction, rtol=_READ_BACK)
        if armature:
            same &= np.allclose(robot.given.drive_inertia, drives.armature, rtol=_READ_BACK)
        if not same or kinematics_digest(robot) != kinematics_digest(self.answer.robot):
            raise UsageError(
                f"{self.source}: values were put in, and others are read back: elements are "
                "written in a way that this program does not know; nothing was written"
            )


def _require_other_files(
    made: Exported, source: Path, result: Path, configuration: Configuration, force: bool
) -> None:
    """Refuse to write over what was read, or over files that are no export."""
    read = [source, result, *([configuration.source] if configuration.source else [])]
    before = made.effects.is_file() and made.changes.is_file()
    for file in filter(Path.exists, made.files):
        if any(file.samefile(other) for other in read):
            raise UsageError(f"{file}: was read for this export; give another --out")
        if not force and not before:
            raise UsageError(
                f"{file}: exists, and is not of an earlier export; give another --out, or --force "
                "to replace it"
            )


def _comments(origin: str, law: DriveLaw, effects: tuple[SimulatedEffect, ...]) -> list[str]:
    lines = [f"From {origin} by idim_iv_ros; changes.md says what is new and how sure it is."]
    if law.in_actuators:
        lines.append(
            "Actuators are the law: ctrl of JOINT is q_ref"
            + (", of JOINT_velocity dq_ref." if law.velocity_reference else ".")
        )
    else:
        lines.append(f"Actuators are motors, ctrl is the torque of the law: {law.words}.")
    missing = [f"{effect.effect} at {effect.joint}" for effect in effects if not effect.native]
    if missing:
        lines.append(f"Not in this file, but in effects.json for Effects: {', '.join(missing)}.")
    return lines


def _write(contents: Mapping[Path, bytes | str], out: Path) -> None:
    """Write all files, or none, and no folder either."""
    try:
        with made_folder(out), complete_files(contents) as temporary:
            for path, content in contents.items():
                with temporary[path].open("wb") as file:
                    file.write(content.encode() if isinstance(content, str) else content)
                    file.flush()
                    os.fsync(file.fileno())
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"{out}: cannot be written: {reason}; give another --out") from error
