"""changes.md: what is new in the exported files, how sure it is, and where it comes from."""

from collections.abc import Sequence

from idim_iv_ros.physical import StandardValue
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.file_text import file_text, number_text
from idim_iv_ros.simulator_files.named import kind_of
from idim_iv_ros.simulator_files.randomization import Ranges
from idim_iv_ros.simulator_files.robot import ExportedRobot

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
    ranges: Ranges | None,
    file: str,
) -> str:
    """Return the page: causes or refit, parameters, ranges, effects, the law, notes.

    `file`: what kind of file the nominal model is, URDF or MJCF.
    """
    joints, remainder = robot.robot.joints, robot.model.remainder
    moved = () if remainder is None else zip(joints, remainder.links, remainder.drives, strict=True)
    beside = [("armature", robot.values("Ia"), "kg m²")] if file == "URDF" else []
    if any(robot.values("off")):
        beside.append(("torque_offset", robot.values("off"), "N m"))
    return file_text(
        "changes.md",
        robot=robot,
        errors=() if robot.gap is None else robot.gap.parameter_errors,
        files=files,
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
        beside=[(key, list(map(number_text, numbers)), unit) for key, numbers, unit in beside],
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
