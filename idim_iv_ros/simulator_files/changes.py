"""changes.md: what is new in the exported files, how sure it is, and where it comes from."""

from collections.abc import Sequence

from idim_iv_ros.physical import StandardValue
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.named import kind_of
from idim_iv_ros.simulator_files.robot import ExportedRobot
from idim_iv_ros.simulator_files.xml_text import number_text

_SOURCES = {
    "recording": "recording",
    "recording and nominal model": "recording; split by the {file}",
    "nominal model": "{file}, as near as the rest lets it be: no motion shows it",
}
_ELEMENTS = {"Fv": "damping", "Fc": "friction", "Ia": "armature", "off": "constant torque"}


def changes_text(
    robot: ExportedRobot,
    effects: Sequence[SimulatedEffect],
    files: Sequence[str],
    notes: Sequence[str],
    *,
    ranges: Sequence[str],
    file: str,
) -> str:
    """Return the page: causes or refit, parameters, ranges, effects, the law, notes.

    `file`: what kind of file the nominal model is, URDF or MJCF.
    """
    lines = [f"# {robot.robot.name}: from {robot.path.name} into a simulator", ""]
    lines += _of_refit(robot) if robot.refit else _of_causes(robot)
    lines += [
        "",
        f"Files: {', '.join(files)}.",
        "",
        "## Parameters",
        "",
        "Links: of the body that each joint carries, with all that is fixed to it, about the "
        "origin of the joint frame. ± is the half-width of the 95 % interval; z the change over "
        f"its standard deviation. What the {file} has a part in has neither: how it splits a sum "
        "has no known error.",
        "",
        "| parameter | given | new | ± | z | unit | source |",
        "|---|---|---|---|---|---|---|",
        *(
            _row(parameter, robot.robot.joints, file)
            for parameter in robot.model.parameters
            if robot.refit or parameter.source != "nominal model"
        ),
        "",
        *_remainder(robot),
        *ranges,
        *_without_element(robot, file),
        *_effect_lines(robot, effects),
        *("## Control law", "", f"{robot.law.words}.", ""),
    ]
    remarks = [*robot.remarks, *notes]
    if remarks:
        lines += ["## Notes", "", *(f"- {remark}" for remark in remarks), ""]
    return "\n".join(lines)


def _of_refit(robot: ExportedRobot) -> list[str]:
    test = robot.physical.test
    return [
        robot.physical.sentence,
        "",
        f"Distance from the estimate to the nearest physical parameters: d² = {test.statistic:.4g} "
        f"with {test.df} degrees of freedom, p = {test.p_value:.3g} (conservative: bounds hold on "
        "one side only).",
    ]


def _of_causes(robot: ExportedRobot) -> list[str]:
    """The causes, and what they leave of the torque gap."""
    rest = "what no cause explains" if robot.model.remainder else "nothing else"
    lines = [f"The nominal model with the causes that the diagnosis names, and {rest}:", ""]
    lines += [f"- {change}" for change in robot.in_parameters]
    lines += [f"- {effect.effect} at {effect.joint or 'all joints'}" for effect in robot.structural]
    lines += [f"- left out: {cause}" for cause in robot.left_out]
    errors = () if robot.gap is None else robot.gap.parameter_errors
    if errors:
        lines += [
            "",
            "What errors of parameters that no cause names make of the torque"
            + (":" if robot.model.remainder else " (`--remainder` spreads it, `--refit` has it):"),
            "",
            "| joint | rms | share of the torque |",
            "|---|---|---|",
        ]
    return lines + [
        f"| {error.joint} | {error.remaining:.3g} | {100.0 * error.share_of_torque:.3g} % |"
        for error in errors
    ]


def _remainder(robot: ExportedRobot) -> list[str]:
    """How far the recording asks for other links and drives than the causes make."""
    remainder = robot.model.remainder
    if remainder is None:
        return []
    joints = zip(robot.robot.joints, remainder.links, remainder.drives, strict=True)
    moved = [
        f"{joint} (link {100.0 * link:.1f} %, drive and friction {100.0 * drive:.1f} %)"
        for joint, link, drive in joints
        if link or drive
    ]
    return [
        "## What no cause explains",
        "",
        "Spread by a prior about the nominal numbers, whose size for each link and each joint has "
        f"maximum evidence: {', '.join(moved) or 'none'}. Where an error is among these is a "
        "guess.",
        "",
    ]


def _without_element(robot: ExportedRobot, file: str) -> list[str]:
    """Where the values are that the file has no element for."""
    armature, offset = robot.values("Ia"), robot.values("off")
    lines = []
    if file == "URDF":
        lines += [f"  armature: [{', '.join(map(number_text, armature))}]   # kg m²"]
    if any(offset):
        lines += [f"  torque_offset: [{', '.join(map(number_text, offset))}]   # N m"]
    if not lines:
        return []
    said = (
        f"What has no element in the {file}, for the nominal model of a configuration (an exported "
        "MJCF has the armature, effects.json the constant torques):"
    )
    return [said, "", "```yaml", "simulator:", *lines, "```", ""]


def _row(parameter: StandardValue, joints: Sequence[str], file: str) -> str:
    name, given, value, std = parameter.name, parameter.given, parameter.value, parameter.std
    kind = kind_of(name)
    where = ""
    if kind in _ELEMENTS:
        where = f" ({_ELEMENTS[kind]} of {joints[int(name.removeprefix(kind)) - 1]})"
    spread, score = (f"{1.96 * std:.2g}", f"{(value - given) / std:+.1f}") if std else ("–", "–")
    return (
        f"| {name}{where} | {given:.6g} | {value:.6g} | {spread} | {score} | "
        f"{parameter.unit} | {_SOURCES[parameter.source].format(file=file)} |"
    )


def _effect_lines(robot: ExportedRobot, effects: Sequence[SimulatedEffect]) -> list[str]:
    lines = ["## Effects", ""]
    if robot.gap is None:
        lines += ["An identification names no cause: `idim-iv diagnose` does.", ""]
    if robot.refit and robot.in_parameters:
        lines += [f"In the parameters above: {'; '.join(robot.in_parameters)}.", ""]
    if not effects:
        return [*lines, "There are none.", ""]
    lines += ["| effect | joint | parameters | where |", "|---|---|---|---|"]
    for effect in effects:
        numbers = ", ".join(f"{name} {value:.6g}" for name, value in effect.parameters.items())
        joint = " and ".join(name for name in (effect.joint, effect.other_joint) if name) or "all"
        where = "elements of the MJCF" if effect.native else "effects.json: `Effects` applies it"
        lines.append(f"| {effect.effect} | {joint} | {numbers} | {where} |")
    return [*lines, ""]
