"""Sections on the parameters: estimates, given and new values, nearest physical set.

A base parameter that groups nothing else is a standard parameter, and has an element of the URDF or
a key of the configuration. Of the others only the sum is known.
"""

import math
import re
from dataclasses import dataclass

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.model.parameters import words_of_name
from idim_iv_ros.physical.result import BaseChange
from idim_iv_ros.report.numerals import INTERVAL, is_number
from idim_iv_ros.report.section import Nominal, Result


def typeset(expression: str) -> str:
    """Return an expression that can break between terms only."""
    text = expression.replace(" - ", " − ").replace("− ", "−\N{NO-BREAK SPACE}")
    text = text.replace("+ ", "+\N{NO-BREAK SPACE}")
    return re.sub(r"(?<=[0-9.]) (?=[A-Za-z])", "\N{NO-BREAK SPACE}", text)


_LARGE = 0.1  # σ from which the change of a base parameter is listed


def moved_parameters(result: Result) -> list[BaseChange]:
    """Return base parameters that the physical set moves by 0.1 σ or more, the farthest first."""
    base = () if result.physical is None else result.physical.base
    moved = [p for p in base if is_number(p.deviations) and abs(p.deviations) >= _LARGE]
    return sorted(moved, key=lambda parameter: -abs(parameter.deviations))


# Kinds of standard parameters that can be set: in a URDF or the configuration, in an MJCF.
_ELEMENTS = {
    "M": ("{link}/inertial/mass", "{link}/inertial/mass"),
    "Ia": ("simulator.armature[{number}]", "{joint}@armature"),
    "Fv": ("{joint}/dynamics@damping", "{joint}@damping"),
    "Fc": ("{joint}/dynamics@friction", "{joint}@frictionloss"),
    "off": ("simulator.torque_offset[{number}]", "simulator.torque_offset[{number}]"),
}


@dataclass(frozen=True)
class ChangedValue:
    """One base parameter of the nominal model: its given value, and its estimate.

    `key` is its element or key, empty where only a sum is known; `words` describe it, with the
    grouped expression of a sum; `std` is that of `new`.
    """

    name: str
    words: str
    key: str
    given: float | None
    new: float
    std: float | None
    unit: str

    @property
    def distance(self) -> float | None:
        """Return the change in standard deviations; None if either is unknown."""
        if self.given is None or not self.std or not math.isfinite(self.std):
            return None
        return (self.new - self.given) / self.std

    @property
    def forest(self) -> tuple[float, float, float] | None:
        """Return (new / given - 1) with its 95 % interval; None if the given value is zero."""
        if not self.given or self.std is None or not math.isfinite(self.std):
            return None
        change, half = self.new / self.given - 1.0, INTERVAL * self.std / abs(self.given)
        return change, change - half, change + half

    @property
    def significant(self) -> bool | None:
        """Return whether the 95 % interval excludes the given value; None if it is unknown."""
        return None if self.distance is None else abs(self.distance) > INTERVAL


def changed_values(result: Result, nominal: Nominal) -> list[ChangedValue]:
    """Return all base parameters, those with an element or a key first, in order of joints."""
    numbers: list[tuple[str, str, float | None, float, float | None, str]]
    if isinstance(result, GapResult):
        expressions: dict[str, str] = {}
        given: dict[str, float] = {}
        if nominal.model is not None:
            base = nominal.model.base
            expressions = dict(zip(base.names, base.expressions, strict=True))
            if any(stage.name == "given" for stage in result.stages):
                given = dict(zip(base.names, map(float, nominal.model.given), strict=True))
        numbers = [
            (name, expressions.get(name, ""), given.get(name), by.value, by.std, by.unit)
            for name, by in result.extended_parameters.items()
        ]
    else:
        numbers = [
            (p.name, p.expression, p.given_value, p.value, p.std, p.unit) for p in result.parameters
        ]
    rows = []
    for name, expression, before, new, std, unit in numbers:
        words, key = _place(name, expression, result.joints, nominal)
        rows.append(ChangedValue(name, words, key, before, new, std, unit))
    return sorted(rows, key=lambda row: not row.key)


def _place(
    name: str, expression: str, joints: tuple[str, ...], nominal: Nominal
) -> tuple[str, str]:
    """Return what a base parameter is in words, and its element or key (a sum: its expression)."""
    parts = re.fullmatch(r"([A-Za-z]+)(\d+)", name)
    if parts is None or expression != name or parts[1] not in _ELEMENTS:
        return expression or name, ""
    number = int(parts[2]) - 1
    if number >= len(joints):
        return name, ""
    link = nominal.skeleton.links[number] if nominal.skeleton else f"link {number + 1}"
    key = _ELEMENTS[parts[1]][nominal.is_mjcf]
    return words_of_name(name, joints), key.format(link=link, joint=joints[number], number=number)
