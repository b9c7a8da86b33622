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
_MOMENTS = {"moment_x": "x", "moment_y": "y", "moment_z": "z"}


@dataclass(frozen=True)
class ChangedValue:
    """One value of the nominal model and what the recording says of it.

    Attributes
    ----------
    name : str
        The standard or base parameter; empty where it is neither.
    key : str
        Element of the URDF or key of the configuration; empty where there is none.
    file : str
        ``URDF``, ``configuration`` or empty.
    words : str
        What it is; for a sum, its grouped expression.
    given, new : float or None
    std : float or None
        Of `new`.
    unit : str
    source : str
        `RECORDING`, `SUM` or the cause that attributes it.
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
    if isinstance(result, GapResult):
        values = [*_estimates_of_diagnosis(result, nominal)]
        attributed = [row for cause in result.causes for row in _of_cause(result, cause, nominal)]
    else:
        values = [
            _row(
                result.joints, p.name, p.expression, p.given_value, p.value, p.std, p.unit, nominal
            )
            for p in result.parameters
        ]
        attributed = []
    keys = {each.key for each in attributed if each.key}
    rows = [*attributed, *(value for value in values if not value.key or value.key not in keys)]
    return sorted(rows, key=lambda row: row.source == SUM)


def _estimates_of_diagnosis(result: GapResult, nominal: Nominal) -> Iterator[ChangedValue]:
    expressions: dict[str, str] = {}
    given: dict[str, float] = {}
    if nominal.model is not None:
        base = nominal.model.base
        expressions = dict(zip(base.names, base.expressions, strict=True))
        if any(stage.name == "given" for stage in result.stages):
            given = dict(zip(base.names, map(float, nominal.model.given), strict=True))
    for name, parameter in result.extended_parameters.items():
        yield _row(
            result.joints,
            name,
            expressions.get(name, ""),
            given.get(name),
            parameter.value,
            parameter.std,
            parameter.unit,
            nominal,
        )


def _row(
    joints: tuple[str, ...],
    name: str,
    expression: str,
    given: float | None,
    new: float,
    std: float | None,
    unit: str,
    nominal: Nominal,
) -> ChangedValue:
    """One base parameter, by its element where it is a standard parameter."""
    row = ChangedValue(name, "", "", expression or name, given, new, std, unit, SUM)
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


def _of_cause(result: GapResult, cause: Cause, nominal: Nominal) -> Iterator[ChangedValue]:
    """Values that a cause attributes to an element or a key."""
    place = cause.joint
    joint = None if place is None else result.joints.index(place)
    source = f"cause: {effect_at(cause.effect, place)}"
    rows: Iterator[ChangedValue] = iter(())
    part = part_of(cause.effect)
    if part in ("drive", "friction"):
        rows = _drives(result, cause, nominal)
    elif part == "gravity":
        rows = _gravity(cause)
    elif joint is None or place is None:
        return
    elif part == "load":
        rows = _payload(cause.parameters, joint, nominal)
    elif part == "link":
        rows = _link_inertia(cause.parameters, joint, nominal)
    elif part == "torque scale":
        rows = _scale(cause, joint, place, nominal)
    elif part == "gains":
        rows = _gains(cause, joint, place, nominal)
    for row in rows:
        yield replace(row, source=source)


def _changed(
    key: str, file: str, words: str, given: float | None, by: EffectParameter
) -> ChangedValue:
    """A given value with the change that a cause found."""
    new = by.value + (given or 0.0)
    return ChangedValue("", key, file, words, given, new, by.std, by.unit, "")


def _drives(result: GapResult, cause: Cause, nominal: Nominal) -> Iterator[ChangedValue]:
    """Friction and drive inertia of a joint, or of all joints by their names."""
    given = None if nominal.model is None else nominal.model.robot.given.of_drives
    for name, parameter in cause.parameters.items():
        place = cause.joint or name
        kind = BY_NAME[cause.effect].standard_kind(name) if cause.joint else "Ia"
        if not kind or place not in result.joints:
            continue
        joint = result.joints.index(place)
        key, file = _key(kind, joint, place, nominal)
        was = None if given is None else float(given[kind][joint])
        yield _changed(key, file, f"{_DRIVES[kind]} of {place}", was, parameter)


def _payload(
    parameters: Mapping[str, EffectParameter], joint: int, nominal: Nominal
) -> Iterator[ChangedValue]:
    """A link to fix to the last one: its mass, and its centre where both are known.

    The ± of the centre holds whatever the correlation of mass and moment is.
    """
    link = _link(joint, nominal)
    mass = parameters.get("mass")
    if mass is None:
        return
    key, words = "payload/inertial/mass", f"mass of a link to fix to {link}"
    yield ChangedValue("", key, _URDF, words, 0.0, mass.value, mass.std, mass.unit, "")
    for name, letter in _MOMENTS.items():
        moment = parameters.get(name)
        if moment is None or mass.value == 0.0:
            continue
        centre = moment.value / mass.value
        std = None
        if moment.std is not None and mass.std is not None:
            std = (moment.std + abs(centre) * mass.std) / abs(mass.value)
        key, words = "payload/inertial/origin@xyz", f"{letter} of its centre in the frame of {link}"
        yield ChangedValue("", f"{key} ({letter})", _URDF, words, None, centre, std, "m", "")


def _link_inertia(
    parameters: Mapping[str, EffectParameter], joint: int, nominal: Nominal
) -> Iterator[ChangedValue]:
    link = _link(joint, nominal)
    for name, parameter in parameters.items():
        parts = re.fullmatch(r"change_of_([A-Z]+)(\d+)", name)
        if parts is None or parts[1] not in INERTIAL:
            continue
        given = None
        if nominal.model is not None:
            column = REGRESSOR_ORDER[INERTIAL.index(parts[1])]
            given = float(nominal.model.robot.given.inertial[joint, column])
        key = f"{link}/inertial/mass" if parts[1] == "M" else f"{link}/inertial"
        words = f"{parts[1]}{parts[2]} about the joint's frame"
        yield _changed(
            key if parts[1] == "M" else f"{key} ({parts[1]})", _URDF, words, given, parameter
        )


def _gravity(cause: Cause) -> Iterator[ChangedValue]:
    for name, parameter in cause.parameters.items():
        words = f"{name.replace('_', ' ')} of the base"
        yield _changed(f"robot.gravity ({name[-1]})", _CONFIGURATION, words, 0.0, parameter)


def _scale(cause: Cause, joint: int, place: str, nominal: Nominal) -> Iterator[ChangedValue]:
    factor = cause.parameters.get("factor")
    if factor is None or nominal.configuration is None:
        return
    scales = nominal.configuration.signals.effort_scale
    given = 1.0 if scales is None else scales[joint]
    std = None if factor.std is None else factor.std * abs(given)
    key, words = f"signals.effort_scale[{joint}]", f"torque per recorded effort of {place}"
    yield ChangedValue(
        "", key, _CONFIGURATION, words, given, given * factor.value, std, factor.unit, ""
    )


def _gains(cause: Cause, joint: int, place: str, nominal: Nominal) -> Iterator[ChangedValue]:
    for name in ("kp", "kd", "ki"):
        each = cause.parameters.get(name)
        law = None if nominal.configuration is None else nominal.configuration.controller
        if each is None or law is None or law.type != "pd":
            continue
        gains = getattr(law, name)
        given = None if gains is None else float(gains[joint])
        key, words = f"controller.{name}[{joint}]", f"{name} of {place}"
        yield ChangedValue(
            "", key, _CONFIGURATION, words, given, each.value, each.std, each.unit, ""
        )


def _context(report: Report[Any]) -> dict[str, Any] | None:
    rows = changed_values(report.result, report.nominal)
    if not rows:
        return None
    return {
        "single": [row for row in rows if row.source != SUM and row.significant is not False],
        "kept": [row for row in rows if row.source != SUM and row.significant is False],
        "sums": [row for row in rows if row.source == SUM],
        "config": report.config,
        "given_known": any(row.given is not None for row in rows),
    }


CHANGES: Section[Any] = Section("Given → new", "changes", "changes.html.j2", _context)
