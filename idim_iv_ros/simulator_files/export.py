"""Export of a result as the files of a simulator: the whole of `idim-iv export`.

Fields of Isaac Lab are those documented for 2.3 and 3.0 (`ActuatorBaseCfg`,
`DelayedPDActuatorCfg`): since Isaac Sim 5 `friction` and `dynamic_friction` are efforts,
`viscous_friction` a coefficient.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import EFFECTS, FilePath, made_folder, write_together
from idim_iv_ros.model import kinematics_digest, load_robot
from idim_iv_ros.model.mjcf import mjcf_as_urdf
from idim_iv_ros.model.urdf import decoded_urdf, description_key
from idim_iv_ros.physical import StandardValue
from idim_iv_ros.physical.pseudo_inertia import LEAST_OF_NOMINAL
from idim_iv_ros.physical.remainder import lower_root
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.kept_files import with_mjcf_values, with_values
from idim_iv_ros.simulator_files.mjcf import mjcf_text, native_effects, number_text
from idim_iv_ros.simulator_files.named import kind_of
from idim_iv_ros.simulator_files.robot import ExportedRobot, read_answer
from idim_iv_ros.simulators.effects_file import EffectsFile

RANDOMIZE = "randomize.py"
_NORMAL = 1.96
_FIELDS = {"Ia": "dof_armature", "Fv": "dof_damping", "Fc": "dof_frictionloss"}


def randomization(
    exported: ExportedRobot, model: str
) -> tuple[dict[str, object], dict[str, object]]:
    """Return the variables of the template of `sample(model, rng)`, and the ranges in changes.md.

    The exported parameters include what no cause explains; `model` is the name of their MJCF. The
    ranges are the usual errors of undetermined parameters, and a row for every body.
    """
    remainder = exported.model.remainder
    assert remainder is not None
    carried = [("joint", name, body) for name, body in exported.bodies.items()]
    mounted = [("load", link, load.parameters) for link, (_, load) in exported.mounted.items()]
    # Intervals of joint numbers by joint and MuJoCo's field, and their rows in the root.
    drives: dict[str, dict[str, str]] = {}
    drive_rows, coordinates, root = [], remainder.coordinates, remainder.root
    for row, place in enumerate(coordinates.drives, 10 * len(coordinates.links)):
        name = exported.model.parameters[place].name
        if (kind := kind_of(name)) in _FIELDS:
            joint = exported.robot.joints[int(name[len(kind) :]) - 1]
            half = _NORMAL * float(np.linalg.norm(root[row]))
            interval = f"{exported.model.values[name]:.4g} ± {half:.2g}"
            drives.setdefault(joint, {})[_FIELDS[kind]] = interval
            drive_rows.append(row)
    bodies, lines = [], []
    for number, (kind, name, body) in enumerate([*carried, *mounted]):
        rows = slice(10 * number, 10 * number + 10)
        reference = coordinates.links[number]
        spread = reference.to_parameters @ root[rows]
        mass, centre = float(body[9]), body[6:9] / body[9]
        moved = np.linalg.norm((spread[6:9] - np.outer(centre, spread[9])) / mass, axis=1)
        shift = ", ".join(f"{1e3 * _NORMAL * std:.2g}" for std in moved)
        half = _NORMAL * float(np.linalg.norm(spread[9]))
        of_joint = drives.get(name, {}) if kind == "joint" else {}
        cells = (of_joint.get(field, "–") for field in _FIELDS.values())
        lines.append((name, f"{mass:.4g} ± {half:.2g}", f"± {shift}", *cells))
        bodies.append((kind, name, reference.factor))
    shown = {
        "model": model,
        "origin": exported.origin,
        "bodies": bodies,
        "joints": [(field, joint) for joint, fields in drives.items() for field in fields],
        "least": LEAST_OF_NOMINAL,
        "root": lower_root(root[[*range(10 * len(bodies)), *drive_rows]]),
    }
    return shown, {"link": remainder.open_links, "drive": remainder.open_drives, "rows": lines}


CHANGES, ISAAC_LAB = "changes.md", "isaac_lab.py"
_TEMPLATES = Environment(
    loader=PackageLoader("idim_iv_ros.simulator_files"),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
_READ_BACK = 1e-6  # of the largest parameter of its kind: digits of a file
_SOURCES = {
    "recording": "recording",
    "recording and nominal model": "recording; split by the {file}",
    "nominal model": "{file}, as near as the rest lets it be: no motion shows it",
}
_ELEMENTS = {"Fv": "damping", "Fc": "friction", "Ia": "armature", "off": "constant torque"}


@dataclass(frozen=True)
class Exported:
    """Paths of the files written by an export, and notes for the user."""

    urdf: Path | None  # None where the nominal model is an MJCF; so is `isaac_lab`
    mjcf: Path
    effects: Path
    isaac_lab: Path | None
    changes: Path
    ranges: Path | None  # Module that samples randomized MuJoCo models, if requested
    not_native: tuple[str, ...] = ()  # Effects that MuJoCo has no element for
    notes: tuple[str, ...] = ()
    bags: tuple[str, ...] = ()  # Names of the recordings that the result is from

    @property
    def files(self) -> tuple[Path, ...]:
        """Return the paths of all files."""
        files = (self.urdf, self.mjcf, self.effects, self.isaac_lab, self.changes, self.ranges)
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

    A diagnosis is exported as the nominal model with its causes, a payload as a separate body; an
    identification by its physical parameters.

    All files are written or none; none replaces a file that was read. An MJCF as nominal model is
    copied with other values in it.

    - `result`: a result.json or gap.json
    - `configuration`: of the robot, with the URDF or MJCF that the result was made with
    - `out`: folder; created if it does not exist
    - `force`: replace files there that an export did not write
    - `refit`: use the physical parameters of a diagnosis, which include what no cause explains
    - `without`: causes that are left out: names of effects, or ``effect@joint``
    - `remainder`: spread the parameter error that no cause explains over links and joints
    - `randomize`: as `remainder`; also write a module that samples robots consistent with the
      recording

    Raises UsageError: the result is not of this robot and URDF, holds an effect that this version
    does not know, or not the cause that is left out; the files cannot be written.
    """
    path, out = Path(result), Path(out)
    source = configuration.robot.description
    if source is None:
        raise UsageError(
            f"{configuration.source or 'configuration'}: robot.urdf is not given: there is no file "
            "whose values could be changed; save the robot description as a URDF first"
        )
    spread = remainder or randomize
    robot = read_answer(path, configuration, source, refit=refit, without=without, remainder=spread)
    of_mjcf = description_key(source) == "mjcf"
    exported = Exported(
        urdf=None if of_mjcf else out / f"{source.stem}.urdf",
        mjcf=out / f"{source.stem}.xml",
        effects=out / EFFECTS,
        isaac_lab=None if of_mjcf else out / ISAAC_LAB,
        changes=out / CHANGES,
        ranges=out / RANDOMIZE if randomize else None,
        bags=robot.bags,
    )
    before = exported.effects.is_file() and exported.changes.is_file()
    for file in filter(Path.exists, exported.files):
        if any(file.samefile(read) for read in (source, path, configuration.source) if read):
            raise UsageError(f"{file}: was read for this export; give another --out")
        if not force and not before:
            raise UsageError(
                f"{file}: exists, and is not of an earlier export; give another --out, or --force "
                "to replace it"
            )
    texts, effects, more = (_export_mjcf if of_mjcf else _export_urdf)(robot, exported)
    notes = (*robot.notes, *more)
    ranges = None
    if exported.ranges is not None:
        shown, ranges = randomization(robot, exported.mjcf.name)
        texts[exported.ranges] = _TEMPLATES.get_template(f"{RANDOMIZE}.j2").render(shown)
    texts[exported.effects] = EffectsFile(
        base_parameters={} if of_mjcf else robot.coupled_friction,
        effects=effects,
        recordings=robot.bags,
    ).to_json()
    texts[exported.changes] = _changes(robot, effects, exported, notes, ranges)
    try:
        with made_folder(out):
            write_together(texts)
    except OSError as error:
        reason = error.strerror or error
        raise UsageError(f"{out}: cannot be written: {reason}; give another --out") from error
    return replace(
        exported,
        not_native=tuple(
            f"{effect.effect} at {effect.joint}" if effect.joint else effect.effect
            for effect in effects
            if not effect.native
        ),
        notes=(*robot.remarks, *notes),
    )


# Contents by file, effects marked as native or not, and notes.
_Written = tuple[dict[Path, bytes | str], tuple[SimulatedEffect, ...], tuple[str, ...]]


def _export_urdf(robot: ExportedRobot, exported: Exported) -> _Written:
    """Write a URDF with its companions, among them a new MJCF with the effects that it can hold."""
    assert exported.urdf is not None and exported.isaac_lab is not None
    native, effects = native_effects(robot.effects, robot.robot, robot.law)
    drives = zip(robot.robot.joints, robot.drives.damping, robot.drives.friction, strict=True)
    dynamics = {name: {"damping": float(d), "friction": float(f)} for name, d, f in drives}
    written = with_values(robot.content, robot.links[0], dynamics, robot.mounted, str(robot.source))
    _require_read_back(robot, decoded_urdf(written))
    texts: dict[Path, bytes | str] = {
        exported.urdf: written,
        exported.mjcf: mjcf_text(robot, native, _comments(robot, effects)),
        exported.isaac_lab: _isaac_lab(robot, exported.urdf.name, effects),
    }
    names = ", ".join(robot.coupled_friction)
    notes = (f"{names}: in {EFFECTS} and the MJCF; a URDF has no place",) if names else ()
    return texts, effects, notes


def _export_mjcf(robot: ExportedRobot, exported: Exported) -> _Written:
    """Write the user's MJCF with new values; effects are left to the callbacks."""
    configuration = robot.configuration
    if configuration.robot.couplings:
        raise UsageError(
            f"{configuration.source or 'configuration'}: robot.couplings: the coupled "
            f"transmission would be a tendon that {robot.source} does not have: diagnose with "
            "the same robot as robot.urdf, whose export makes an MJCF with it"
        )
    written, notes = with_mjcf_values(robot)
    _require_read_back(robot, mjcf_as_urdf(robot.source, decoded_urdf(written)), armature=True)
    notes += (
        "everything else of the MJCF is as it was, actuators and time step too: they need not "
        "be the law of the configuration, which is in changes.md",
        "dry friction turns as early as in the recording, not 10 ms before the joint as with "
        "MuJoCo's default: that is solreffriction of the joints",
        f"there is no {ISAAC_LAB}: it needs a URDF",
    )
    if configuration.simulator.armature is not None:
        notes += ("the MJCF holds the armature now: leave out simulator.armature beside it",)
    return {exported.mjcf: written}, robot.effects, notes


def _require_read_back(exported: ExportedRobot, text: str, *, armature: bool = False) -> None:
    """Read the new file as this program reads any, and check its parameters."""
    bodies, drives = exported.bodies, exported.drives
    robot = load_robot(text, list(bodies), source=str(exported.source))
    meant = np.array(list(bodies.values()))
    for load in exported.model.loads:
        meant[list(bodies).index(load.joint)] += load.parameters
    inertial = robot.given.of_bodies
    same = np.allclose(inertial, meant, rtol=0.0, atol=_READ_BACK * np.abs(meant).max())
    same &= np.allclose(robot.given.viscous, drives.damping, rtol=_READ_BACK)
    same &= np.allclose(robot.given.coulomb, drives.friction, rtol=_READ_BACK)
    if armature:
        same &= np.allclose(robot.given.drive_inertia, drives.armature, rtol=_READ_BACK)
    if not same or kinematics_digest(robot) != kinematics_digest(exported.robot):
        raise UsageError(
            f"{exported.source}: values were put in, and others are read back: elements are "
            "written in a way that this program does not know; nothing was written"
        )


def _comments(robot: ExportedRobot, effects: Sequence[SimulatedEffect]) -> list[str]:
    law = robot.law
    lines = [f"From {robot.origin} by idim_iv_ros; changes.md says what is new and how sure it is."]
    if law.in_actuators:
        speed = ", of JOINT_velocity dq_ref" if law.velocity_reference else ""
        lines.append(f"Actuators are the law: ctrl of JOINT is q_ref{speed}.")
    else:
        lines.append(f"Actuators are motors, ctrl is the torque of the law: {law.words}.")
    missing = [f"{effect.effect} at {effect.joint}" for effect in effects if not effect.native]
    if missing:
        lines.append(f"Not in this file, but in effects.json for Effects: {', '.join(missing)}.")
    return lines


def _changes(
    robot: ExportedRobot,
    effects: Sequence[SimulatedEffect],
    exported: Exported,
    notes: Sequence[str],
    ranges: Mapping[str, object] | None,
) -> str:
    """Return the table of changes: new values, their certainty and their origin."""
    joints, remainder = robot.robot.joints, robot.model.remainder
    file = "MJCF" if exported.urdf is None else "URDF"
    moved = () if remainder is None else zip(joints, remainder.links, remainder.drives, strict=True)
    local = [("armature", robot.values("Ia"), "kg m²")] if file == "URDF" else []
    if any(robot.values("off")):
        local.append(("torque_offset", robot.values("off"), "N m"))
    return _TEMPLATES.get_template("changes.md.j2").render(
        robot=robot,
        errors=() if robot.gap is None else robot.gap.parameter_errors,
        files=[path.name for path in exported.files],
        file=file,
        rows=[
            _row(parameter, joints, file)
            for parameter in robot.model.parameters
            if robot.refit or parameter.source != "nominal model"
        ],
        moved=[
            f"{joint} (link {100.0 * link:.1f} %, drive and friction {100.0 * drive:.1f} %)"
            for joint, link, drive in moved
            if link or drive
        ],
        ranges=ranges,
        settings=[(key, list(map(number_text, numbers)), unit) for key, numbers, unit in local],
        effects=effects,
        notes=[*robot.remarks, *notes],
    )


def _row(parameter: StandardValue, joints: Sequence[str], file: str) -> tuple[str, ...]:
    name, given, value, std = parameter.name, parameter.given, parameter.value, parameter.std
    kind = kind_of(name)
    where = ""
    if kind in _ELEMENTS:
        where = f" ({_ELEMENTS[kind]} of {joints[int(name.removeprefix(kind)) - 1]})"
    spread, score = (f"{1.96 * std:.2g}", f"{(value - given) / std:+.1f}") if std else ("–", "–")
    source = _SOURCES[parameter.source].format(file=file)
    return f"{name}{where}", f"{given:.6g}", f"{value:.6g}", spread, score, parameter.unit, source


def _isaac_lab(exported: ExportedRobot, urdf_name: str, effects: Sequence[SimulatedEffect]) -> str:
    """Return the Isaac Lab file, for the exported URDF of that name in the same folder.

    Effects that no field expresses are listed in a comment.
    """
    law = exported.law
    delayed = bool(law.configured and any(law.delay))
    # A delay is that of a group: one for each length.
    steps = [round(float(delay) / law.period) if delayed else 0 for delay in law.delay]
    parts = [(effect, part_of(effect.effect)) for effect in effects]
    names, values = np.array(exported.robot.joints), exported.drives
    gains = [("stiffness", law.kp, "N m/rad"), ("damping", law.kd, "N m s/rad")]
    fields = [
        *(gains if law.configured else []),
        ("armature", values.armature, "kg m2"),
        ("friction", values.friction, "N m: static, an effort"),
        ("dynamic_friction", values.friction, "N m: Coulomb; static friction beyond it is unknown"),
        ("viscous_friction", values.damping, "N m s/rad"),
        ("effort_limit", law.limit, "N m"),
    ]
    groups = {}
    for delay in sorted(set(steps)):
        chosen, listed = np.equal(steps, delay), []
        for field, numbers, unit in fields:
            there = np.isfinite(numbers) & chosen
            by_joint = dict(zip(names[there].tolist(), numbers[there].tolist(), strict=True))
            listed += [(field, unit, by_joint)] if by_joint else []
        groups[delay] = (names[chosen].tolist(), listed)
    return _TEMPLATES.get_template("isaac_lab.py.j2").render(
        robot=exported.robot,
        couplings=exported.drives.couplings,
        law=law,
        offsets=dict(zip(exported.robot.joints, exported.drives.offset, strict=True)),
        origin=exported.origin,
        urdf=urdf_name,
        delayed=delayed,
        groups=groups,
        effects=[
            effect
            for effect, part in parts
            if part not in ("delay", "offset") and (part != "gains" or law.beyond)
        ],
    )
