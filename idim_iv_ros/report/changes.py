"""What to change in the nominal model: given and new values by URDF element and configuration key.

A base parameter that groups nothing else is a standard parameter, and has an element or a key of
its own. Of the others only the sum is known. A parametric cause attributes a change to one element
where the recording alone does not: its rows name the cause.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.result import Cause, EffectParameter, GapResult
from idim_iv_ros.effects.registry import BY_NAME, part_of
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.model.parameters import INERTIAL, REGRESSOR_ORDER
from idim_iv_ros.report.gap_words import effect_at
from idim_iv_ros.report.numerals import INTERVAL
from idim_iv_ros.report.section import Nominal, Report, Section

RECORDING, SUM = "the recording alone", "only the sum is known"
_CONFIGURATION, _URDF = "configuration", "URDF"
_DRIVES = {"Ia": "drive inertia", "Fv": "viscous friction", "Fc": "Coulomb friction"}


@dataclass(frozen=True)
class ChangedValue:
    """One value of the nominal model and what the recording says of it.

    `name` is that of a standard or base parameter, `key` the element of the URDF or the key of the
    configuration (`file`); they are empty where there is none. `words` say what it is, of a sum its
    grouped expression; `std` is that of `new`; `source` is `RECORDING`, `SUM` or the cause that
    attributes it.
    """

    name: str
    key: str
    file: str
    words: str
    given: float | None
    new: float
    std: float | None
    unit: str
    source: str

    @property
    def distance(self) -> float | None:
        """Change in standard deviations; None where either is unknown."""
        if self.given is None or not self.std or not math.isfinite(self.std):
            return None
        return (self.new - self.given) / self.std

    @property
    def forest(self) -> tuple[float, float, float] | None:
        """New value and its 95 % interval over the given one, less 1; None if that is zero."""
        if not self.given or self.std is None or not math.isfinite(self.std):
            return None
        change, half = self.new / self.given - 1.0, INTERVAL * self.std / abs(self.given)
        return change, change - half, change + half

    @property
    def significant(self) -> bool | None:
        """Whether the 95 % interval leaves the given value out; None where it is not known."""
        return None if self.distance is None else abs(self.distance) > INTERVAL


def changed_values(
    result: IdentificationResult | GapResult, nominal: Nominal
) -> list[ChangedValue]:
    """Return all values, those with an element or a key first, in the order of the joints."""
    values = [_at_element(result.joints, row, nominal) for row in _base_parameters(result, nominal)]
    causes = result.causes if isinstance(result, GapResult) else ()
    attributed = [row for cause in causes for row in _of_cause(result.joints, cause, nominal)]
    keys = {part.key for part in attributed if part.key}
    rows = [*attributed, *(value for value in values if not value.key or value.key not in keys)]
    return sorted(rows, key=lambda row: row.source == SUM)


def _base_parameters(
    result: IdentificationResult | GapResult, nominal: Nominal
) -> Iterator[ChangedValue]:
    """All base parameters, each with its grouped expression, empty where that is not known."""
    if not isinstance(result, GapResult):
        for p in result.parameters:
            numbers = (p.given_value, p.value, p.std)
            yield ChangedValue(p.name, "", "", p.expression, *numbers, p.unit, SUM)
        return
    expressions: dict[str, str] = {}
    given: dict[str, float] = {}
    if nominal.model is not None:
        base = nominal.model.base
        expressions = dict(zip(base.names, base.expressions, strict=True))
        if any(stage.name == "given" for stage in result.stages):
            given = dict(zip(base.names, map(float, nominal.model.given), strict=True))
    for name, by in result.extended_parameters.items():
        words = expressions.get(name, "")
        yield ChangedValue(name, "", "", words, given.get(name), by.value, by.std, by.unit, SUM)


def _at_element(joints: tuple[str, ...], row: ChangedValue, nominal: Nominal) -> ChangedValue:
    """A base parameter by its element or key where it is a standard parameter."""
    name, expression = row.name, row.words
    row = replace(row, words=expression or name)
    parts = re.fullmatch(r"([A-Za-z]+)(\d+)", name)
    if parts is None or expression != name or int(parts[2]) > len(joints):
        return row
    kind, joint = parts[1], int(parts[2]) - 1
    place = joints[joint]
    if kind == "off":
        words = f"torque offset of {place}: neither file has it"
        return replace(row, words=words, source=RECORDING)
    key, file = _key(kind, joint, place, nominal)
    if not key:
        return row
    words = f"{_DRIVES.get(kind, 'mass')} of {place}"
    return replace(row, key=key, file=file, words=words, source=RECORDING)


def _key(kind: str, joint: int, place: str, nominal: Nominal) -> tuple[str, str]:
    if nominal.is_mjcf:
        attribute = {"Ia": "armature", "Fv": "damping", "Fc": "frictionloss"}.get(kind, "")
        if attribute:
            return f"{place}@{attribute}", _URDF
    keys = {
        "Ia": (f"simulator.armature[{joint}]", _CONFIGURATION),
        "Fv": (f"{place}/dynamics@damping", _URDF),
        "Fc": (f"{place}/dynamics@friction", _URDF),
        "M": (f"{_link(joint, nominal)}/inertial/mass", _URDF),
    }
    return keys.get(kind, ("", ""))


def _link(joint: int, nominal: Nominal) -> str:
    return nominal.skeleton.links[joint] if nominal.skeleton else f"link {joint + 1}"


def _of_cause(joints: tuple[str, ...], cause: Cause, nominal: Nominal) -> Iterator[ChangedValue]:
    """Values that a cause attributes to an element or a key."""
    joint = None if cause.joint is None else joints.index(cause.joint)
    if part_of(cause.effect) == "load" and joint is not None:
        rows = _payload(cause.parameters, joint, nominal)
    else:
        rows = (
            row
            for name, parameter in cause.parameters.items()
            for row in _of_number(joints, cause, name, parameter, nominal)
        )
    source = f"cause: {effect_at(cause.effect, cause.joint)}"
    return (replace(row, source=source) for row in rows)


def _of_number(
    joints: tuple[str, ...], cause: Cause, name: str, by: EffectParameter, nominal: Nominal
) -> Iterator[ChangedValue]:
    """The value that one number of a cause changes; none where no file has it.

    A number changes a standard parameter of its joint (of all drives at once it has the name of a
    joint), or a setting of the configuration.
    """
    place = name if name in joints else cause.joint
    kind = "Ia" if name in joints else BY_NAME[cause.effect].standard_kind(name)
    standard = None
    if place is not None and kind:
        standard = _standard(kind, joints.index(place), place, nominal)
    if standard is not None:
        given, key, file, words = standard
        new = by.value + (given or 0.0)
        yield ChangedValue("", key, file, words, given, new, by.std, by.unit, "")
    else:
        yield from _setting(joints, cause, name, by, nominal.configuration)


def _standard(
    kind: str, joint: int, place: str, nominal: Nominal
) -> tuple[float | None, str, str, str] | None:
    """Given value, key, file and words of a standard parameter; None of one without an element."""
    robot = None if nominal.model is None else nominal.model.robot.given
    if kind in _DRIVES:
        key, file = _key(kind, joint, place, nominal)
        given = None if robot is None else float(robot.of_drives[kind][joint])
        return given, key, file, f"{_DRIVES[kind]} of {place}"
    if kind not in INERTIAL:
        return None
    given = (
        None
        if robot is None
        else float(robot.inertial[joint, REGRESSOR_ORDER[INERTIAL.index(kind)]])
    )
    link = f"{_link(joint, nominal)}/inertial"
    key = f"{link}/mass" if kind == "M" else f"{link} ({kind})"
    return given, key, _URDF, f"{kind}{joint + 1} about the joint's frame"


def _setting(
    joints: tuple[str, ...],
    cause: Cause,
    name: str,
    by: EffectParameter,
    configuration: Configuration | None,
) -> Iterator[ChangedValue]:
    """The key of the configuration that a number changes, where it is one."""
    part, place = part_of(cause.effect), cause.joint
    words = f"{BY_NAME[cause.effect].parameter_words(name)}{f', {place}' if place else ''}"
    given: float | None = 0.0
    scale = 1.0
    if part == "gravity":
        key = f"robot.gravity ({name[-1]})"
    elif place is None or configuration is None:
        return
    elif part == "torque scale":
        key, scales = "signals.effort_scale", configuration.signals.effort_scale
        given = scale = 1.0 if scales is None else scales[joints.index(place)]
    else:
        law = configuration.controller
        if part != "gains" or law is None or law.type != "pd" or name not in ("kp", "kd", "ki"):
            return
        key, gains = f"controller.{name}", getattr(law, name)
        given = None if gains is None else float(gains[joints.index(place)])
    if part != "gravity":
        key += f"[{joints.index(place)}]"
    std = None if by.std is None else by.std * abs(scale)
    new = by.value * scale
    yield ChangedValue("", key, _CONFIGURATION, words, given, new, std, by.unit, "")


def _payload(
    parameters: Mapping[str, EffectParameter], joint: int, nominal: Nominal
) -> Iterator[ChangedValue]:
    """A link to fix to the last one: its mass, and its centre where both are determined.

    The ± of the centre covers any correlation of mass and moment.
    """
    link = _link(joint, nominal)
    mass = parameters.get("mass")
    if mass is None:
        return
    key, words = "payload/inertial/mass", f"mass of a link to fix to {link}"
    yield ChangedValue("", key, _URDF, words, 0.0, mass.value, mass.std, mass.unit, "")
    for axis in "xyz" if mass.value else "":
        moment = parameters.get(f"moment_{axis}")
        if moment is None:
            continue
        centre = moment.value / mass.value
        std = None
        if moment.std is not None and mass.std is not None:
            std = (moment.std + abs(centre) * mass.std) / abs(mass.value)
        key, words = f"payload/inertial/origin@xyz ({axis})", f"{axis} of its centre in {link}"
        yield ChangedValue("", key, _URDF, words, None, centre, std, "m", "")


def _context(report: Report[Any]) -> dict[str, Any] | None:
    rows = changed_values(report.result, report.nominal)
    if not rows:
        return None
    return {
        "single": [row for row in rows if row.source != SUM and row.significant is not False],
        "kept": [row for row in rows if row.source != SUM and row.significant is False],
        "sums": [row for row in rows if row.source == SUM],
        "config": report.files.config,
        "given_known": any(row.given is not None for row in rows),
    }


CHANGES: Section[Any] = Section("Given → new", "changes", "changes.html.j2", _context)
