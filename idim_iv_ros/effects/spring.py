"""A spring on the joint: a gravity compensator, a cable, a hose."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import GivenNumbers, ParameterSpec
from idim_iv_ros.effects.contribution import Element, Instant, Torque, TorqueLaw, TorqueTerm
from idim_iv_ros.effects.effect import JointRange, Place, Shape, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_CENTRES = 9
_WIDTHS = (0.1, 0.2, 0.4, 0.8)  # of the range
_POWERS = ("constant", "linear", "quadratic", "cubic")


@dataclass(frozen=True)
class LineShape(Shape):
    """Lowest and highest position, rad: outside them the torque of a linear spring is constant."""

    lowest: float
    highest: float


class CubicShape(LineShape):  # has the same numbers: it is asked for before a line is
    """Lowest and highest position, rad: outside them a cubic polynomial is constant."""


@dataclass(frozen=True)
class BentShape(Shape):
    """linear q + bent sinh((q − centre) / width) where it hardens, arctan where it softens."""

    hardening: bool
    lowest: float
    highest: float
    centre: float
    width: float


SpringShape = LineShape | BentShape


@kernel
def _polynomial(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Values: constant, linear, quadratic, cubic, lowest, highest."""
    x = min(max(at.position, p[4]), p[5])
    return Torque(0.0, 0.0, p[0] + x * (p[1] + x * (p[2] + x * p[3])), 0.0)


@kernel
def _bent(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Values: bent, centre, width, hardening, lowest, highest."""
    x = (min(max(at.position, p[4]), p[5]) - p[1]) / p[2]
    return Torque(0.0, 0.0, p[0] * (math.sinh(x) if p[3] != 0.0 else math.atan(x)), 0.0)


class Spring(StructuralEffect[SpringShape]):
    """A smooth function of the position, the same in both directions.

    Of a linear one the constant says where it rests, which may be far from where the joint is; else
    it is the model's offset, as it is in a refit. A refit has what looks like gravity, too.
    """

    name = "spring"
    order = 130
    family = "position"
    signed = True  # the model absorbs what looks like gravity, and what is left has no sign
    excitation = "the whole range of the joint, slowly"
    segments = ("range_sweep",)
    typical = ShareOf("peak", 0.1)
    specs = (
        ParameterSpec("constant", "N m", "offset"),
        ParameterSpec("linear", "N m/rad", "coefficient of q"),
        ParameterSpec("quadratic", "N m/rad²", "coefficient of q²"),
        ParameterSpec("cubic", "N m/rad³", "coefficient of q³"),
        ParameterSpec("bent", "N m", "coefficient of the bent part"),
        ParameterSpec("lowest", "rad", "constant below", -math.inf, "unbounded"),
        ParameterSpec("highest", "rad", "constant above", math.inf, "unbounded"),
        ParameterSpec("hardening", "", "bent part hardens (1) or softens (0)", 1.0, "0 or 1"),
        ParameterSpec("centre", "rad", "centre of the bent part"),
        ParameterSpec("width", "rad", "width of the bent part", 1.0, "positive"),
    )
    polynomial, bent = laws = TorqueLaw(_polynomial), TorqueLaw(_bent)
    in_offset = ("constant",)
    element_of = "joint"

    def grid(self, covered: JointRange) -> list[SpringShape]:
        """A line, a cubic, and both bends with centres over the range and four widths."""
        low, high = covered.low, covered.high
        if high <= low:
            return []
        bent = [
            BentShape(hardens, low, high, float(centre), width * (high - low))
            for hardens in (True, False)
            for centre in np.linspace(low, high, _CENTRES)
            for width in _WIDTHS
        ]
        return [LineShape(low, high), CubicShape(low, high), *bent]

    def neighbours(self, shape: SpringShape, step: float, covered: JointRange) -> list[SpringShape]:
        """Shapes with a nearby centre and width of the bend."""
        if not isinstance(shape, BentShape):
            return []
        centre, width, span = shape.centre, shape.width, shape.highest - shape.lowest
        return [
            replace(shape, centre=centre + step * width),
            replace(shape, centre=centre - step * width),
            replace(shape, width=min(width * (1.0 + step), span)),
            replace(shape, width=max(width / (1.0 + step), 0.05 * span)),
        ]

    def columns(self, motion: RobotMotion, place: Place, shape: SpringShape) -> Torques:
        """A line; powers of the position; or the position and the bend."""
        q = np.clip(motion.position[:, place.joint], shape.lowest, shape.highest)
        if isinstance(shape, CubicShape):
            return {place.joint: np.column_stack([q, q**2, q**3])}
        if isinstance(shape, LineShape):
            return {place.joint: np.column_stack([np.ones_like(q), q])}
        bend = np.sinh if shape.hardening else np.arctan
        return {place.joint: np.column_stack([q, bend((q - shape.centre) / shape.width)])}

    def names(self, shape: SpringShape) -> tuple[str, ...]:
        """Names of the coefficients: of a line, of powers, or of a line and its bent part."""
        if isinstance(shape, BentShape):
            return "linear", "bent"
        return _POWERS[1:] if isinstance(shape, CubicShape) else _POWERS[:2]

    def element(self, value: Mapping[str, float], low: float, high: float) -> Element | None:
        """A polynomial stiffness, where the joint never leaves the range of the polynomial."""
        lowest, highest = value.get("lowest", -math.inf), value.get("highest", math.inf)
        if value.get("bent") or value.get("constant") or low < lowest or high > highest:
            return None
        return Element(stiffness=tuple(value.get(name, 0.0) for name in _POWERS[1:]))

    def refused(self, value: Mapping[str, float]) -> str:
        """Why the range between `lowest` and `highest` is empty; empty if it is not."""
        return "" if value["lowest"] < value["highest"] else "lowest is not below highest"

    def contributions(self, given: GivenNumbers) -> Iterator[TorqueTerm]:
        """The polynomial, and the bent part where there is one."""
        yield TorqueTerm(self.polynomial, given.values(*_POWERS, "lowest", "highest"))
        if given.value["bent"] != 0.0:
            bend = ("bent", "centre", "width", "hardening")
            yield TorqueTerm(self.bent, given.values(*bend, "lowest", "highest"))
