"""changes.md: what is new in the exported files, how sure it is, and where it comes from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.model.units import unit_at
from idim_iv_ros.physical import StandardValue
from idim_iv_ros.simulator_files.answer import Answer
from idim_iv_ros.simulator_files.law import DriveLaw
from idim_iv_ros.simulator_files.links import LinkBody
from idim_iv_ros.simulators.effects_file import PlantedEffect

_SOURCES = {
    "recording": "recording",
    "recording and nominal model": "recording; split by the {file}",
    "nominal model": "{file}, as near as the rest lets it be: no motion shows it",
}
_DRIVES = (
    ("Fv", "damping", "N m s/rad"),
    ("Fc", "friction", "N m"),
    ("Ia", "armature", "kg m²"),
    ("off", "torque_offset", "N m"),
)


@dataclass(frozen=True)
class ChangedLink:
    """Inertial of a link before (None where the URDF has none) and after."""

    name: str
    before: LinkBody | None
    after: LinkBody


def changes_text(
    answer: Answer,
    links: Sequence[ChangedLink],
    effects: Sequence[PlantedEffect],
    law: DriveLaw,
    files: Sequence[str],
    notes: Sequence[str],
    *,
    file: str = "URDF",
) -> str:
    """Return the page: parameters of the model, elements of the file, effects, the law, notes.

    `file`: what kind of file the nominal model is, URDF or MJCF.
    """
    physical = answer.physical
    test = physical.test
    lines = [
        f"# {answer.robot.name}: from {answer.path.name} into a simulator",
        "",
        physical.sentence,
        "",
        f"Distance from the estimate to the nearest physical parameters: d² = {test.statistic:.4g} "
        f"with {test.df} degrees of freedom, p = {test.p_value:.3g} (conservative: bounds hold on "
        "one side only).",
        "",
        f"Files: {', '.join(files)}.",
        "",
        "## Drives and friction",
        "",
        "± is the half-width of the 95 % interval; z the change over its standard deviation. What "
        f"the {file} has a part in has neither: how it splits a sum has no known error.",
        "",
        "| joint | element | given | new | ± | z | unit | source |",
        "|---|---|---|---|---|---|---|---|",
        *_drive_rows(answer, file),
        "",
        *_without_element(answer, file),
        "## Links",
        "",
        "Parameters of the body that each joint carries, with all that is fixed to it, about the "
        "origin of the joint frame.",
        "",
        "| parameter | given | new | ± | z | unit | source |",
        "|---|---|---|---|---|---|---|",
        *(_row(each, file) for each in physical.parameters if not _is_drive(each)),
        "",
        f"Elements of the {file}, centre and moments in the axes of the "
        + ("link's frame:" if file == "URDF" else "body, centre from the anchor of its joint:"),
        "",
        "| link | mass, kg | centre, m | moments ixx iyy izz, kg m² |",
        "|---|---|---|---|",
        *(line for each in links for line in _link_rows(each)),
        "",
    ]
    lines += _effect_lines(answer, effects)
    lines += ["## Control law", "", f"{law.words}.", ""]
    remarks = [*answer.notes, *notes]
    if remarks:
        lines += ["## Notes", "", *(f"- {each}" for each in remarks), ""]
    return "\n".join(lines)


def _without_element(answer: Answer, file: str) -> list[str]:
    """Where the values are that the file has no element for."""
    if file == "URDF":
        said = (
            "`armature` and `torque_offset` have no element in a URDF. The MJCF has the first, "
            "effects.json the second; for the nominal model of a configuration:"
        )
        return [said, "", "```yaml", *simulator_lines(answer), "```", ""]
    offset = simulator_lines(answer)[2:]
    if not offset:
        return []
    said = (
        "`torque_offset` has no element in an MJCF. It is in effects.json; for the nominal model "
        "of a configuration:"
    )
    return [said, "", "```yaml", "simulator:", *offset, "```", ""]


def simulator_lines(answer: Answer) -> list[str]:
    """Section `simulator` of a configuration whose URDF is the exported one."""
    robot = answer.robot
    armature = [
        answer.value("Ia", joint, float(robot.given.drive_inertia[joint]))
        for joint in range(len(robot.joints))
    ]
    offset = [
        answer.value("off", joint, float(robot.given.offset[joint]))
        for joint in range(len(robot.joints))
    ]
    lines = ["simulator:", f"  armature: [{', '.join(map(repr, armature))}]   # kg m²"]
    if any(offset):
        lines.append(f"  torque_offset: [{', '.join(map(repr, offset))}]   # N m")
    return lines


def _is_drive(each: StandardValue) -> bool:
    return each.name.startswith(("Fv", "Fc", "Ia", "off"))


def _drive_rows(answer: Answer, file: str) -> list[str]:
    robot = answer.robot
    values = {each.name: each for each in answer.physical.parameters}
    rows = []
    for joint, name in enumerate(robot.joints):
        for kind, element, unit in _DRIVES:
            shown = unit_at(unit, robot.joint_types[joint])
            each = values.get(f"{kind}{joint + 1}")
            if each is None:
                given = float(robot.given.of_drives[kind][joint])
                rows.append(
                    f"| {name} | {element} | {given:.6g} | {given:.6g} | – | – | {shown} | "
                    f"{file} or configuration: not part of the model |"
                )
            else:
                rows.append(f"| {name} | {element} {_cells(each, file)}")
    for each in answer.physical.parameters:
        if each.name.startswith(("Fvm", "Fcm")):
            rows.append(f"| transmission | {each.name} {_cells(each, file)}")
    return rows


def _row(each: StandardValue, file: str) -> str:
    return f"| {each.name} {_cells(each, file)}"


def _cells(each: StandardValue, file: str) -> str:
    spread = score = "–"
    if each.std is not None and each.std > 0.0:
        spread = f"{1.96 * each.std:.2g}"
        score = f"{(each.value - each.given) / each.std:+.1f}"
    return (
        f"| {each.given:.6g} | {each.value:.6g} | {spread} | {score} | {each.unit} | "
        f"{_SOURCES[each.source].format(file=file)} |"
    )


def _link_rows(link: ChangedLink) -> list[str]:
    rows = [] if link.before is not None else [f"| {link.name}, given | none | – | – |"]
    for word, body in (("given", link.before), ("new", link.after)):
        if body is not None:
            centre = ", ".join(f"{value:.5g}" for value in body.centre)
            moments = ", ".join(f"{value:.5g}" for value in np.diag(body.inertia))
            rows.append(f"| {link.name}, {word} | {body.mass:.6g} | {centre} | {moments} |")
    return rows


def _effect_lines(answer: Answer, effects: Sequence[PlantedEffect]) -> list[str]:
    lines = ["## Effects", ""]
    if not answer.diagnosed:
        lines += ["An identification names no cause: `idim-iv diagnose` does.", ""]
    if answer.in_parameters:
        lines += [f"In the parameters above: {', '.join(answer.in_parameters)}.", ""]
    if not effects:
        return [*lines, "There are none.", ""]
    lines += ["| effect | joint | parameters | where |", "|---|---|---|---|"]
    for each in effects:
        numbers = ", ".join(f"{name} {value:.6g}" for name, value in each.parameters.items())
        joint = " and ".join(name for name in (each.joint, each.other_joint) if name) or "all"
        where = "elements of the MJCF" if each.native else "effects.json: `Effects` applies it"
        lines.append(f"| {each.effect} | {joint} | {numbers} | {where} |")
    return [*lines, ""]
