"""Dry friction that depends on the position: a bent shaft, a worn or tight spot."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import GivenNumbers, ParameterSpec
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw, TorqueTerm
from idim_iv_ros.effects.effect import JointRange, Place, Shape, ShareOf
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.effects.waves import WaveEffect, Waves, wave, wave_columns, wave_specs
from idim_iv_ros.types import FloatArray

_BEYOND = 0.2  # of the range: a spot may lie outside, its flank inside


@dataclass(frozen=True)
class TightSpot(Shape):
    """Centre and width of a tight spot, rad (m)."""

    centre: float
    width: float


SpotOrWaves = TightSpot | Waves


@kernel
def _waves(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    return Torque(wave(p, at.position), 0.0, 0.0, 0.0)


@kernel
def _spot(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Friction of a tight spot from the parameters p = (centre, width, height)."""
    return Torque(p[2] * math.exp(-(((at.position - p[0]) / p[1]) ** 2)), 0.0, 0.0, 0.0)


class PositionDependentFriction(WaveEffect):
    """sign(dq) · (waves of the position, or height · exp(−((q − centre) / width)²))."""

    name = "position_dependent_friction"
    order = 50
    part = "friction"
    family = "position"
    signed = True  # a spot may be tight or loose
    periods, lowest = 0.7, 0.0
    excitation = "the same places in both directions, slowly"
    segments = ("range_sweep",)
    typical = ShareOf("dry friction", 0.1)  # 5 to 15 %
    specs = (
        *wave_specs("friction"),
        ParameterSpec("centre", "rad", "centre of the spot"),
        ParameterSpec("width", "rad", "width of the spot", 1.0, "positive"),
        ParameterSpec("height", "N m", "friction there beyond that elsewhere"),
    )
    spot, waves = laws = TorqueLaw(_spot), TorqueLaw(_waves)

    def grid(self, covered: JointRange) -> list[SpotOrWaves]:
        """Shapes with a single wave, and with a single tight spot."""
        low, high, span = covered.low, covered.high, covered.span
        if span <= 0.0:
            return []
        spots = [
            TightSpot(float(centre), width * span)
            for width in (0.06, 0.15, 0.35)
            for centre in np.linspace(low - _BEYOND * span, high + _BEYOND * span, 31)
            if low - width * span < centre < high + width * span
        ]
        return [*super().grid(covered), *spots]

    def branches(self, grid: Sequence[SpotOrWaves]) -> list[Sequence[SpotOrWaves]]:
        """Waves and spots: one wave may fit worse than a spot, and two better."""
        return [[shape for shape in grid if isinstance(shape, kind)] for kind in (Waves, TightSpot)]

    def neighbours(self, shape: SpotOrWaves, step: float, covered: JointRange) -> list[SpotOrWaves]:
        """Shapes with nearby wave numbers, or with a nearby centre and width."""
        if isinstance(shape, Waves):
            return super().neighbours(shape, step, covered)
        centre, width = shape.centre, shape.width
        moved = [TightSpot(centre + sign * step * width, width) for sign in (1.0, -1.0)]
        moved += [TightSpot(centre, width * (1 + step)), TightSpot(centre, width / (1 + step))]
        return [
            spot
            for spot in moved
            if covered.low - spot.width < spot.centre < covered.high + spot.width
        ]

    def names(self, shape: SpotOrWaves) -> tuple[str, ...]:
        """Amplitudes of the waves, or the height of the spot."""
        return ("height",) if isinstance(shape, TightSpot) else super().names(shape)

    def torques(
        self, motion: RobotMotion, place: Place, shapes: Sequence[SpotOrWaves]
    ) -> list[Torques]:
        """`columns` of several shapes, with all waves computed at once."""
        q = np.ascontiguousarray(motion.position[:, place.joint])
        sign = np.ascontiguousarray(motion.slip[:, place.joint])
        waves = iter(wave_columns(q, [shape for shape in shapes if isinstance(shape, Waves)]))
        made = []
        for shape in shapes:
            if isinstance(shape, Waves):
                values = next(waves)
            else:
                values = np.exp(-(((q - shape.centre) / shape.width) ** 2))[:, None]
            made.append({place.joint: values * sign[:, None]})
        return made

    def contributions(self, given: GivenNumbers) -> Iterator[TorqueTerm]:
        """Dry friction of the spot, or of all waves."""
        spot = given.values("centre", "width", "height")
        yield TorqueTerm(self.spot, spot, friction=True, dry=True)
        for term in given.terms:
            values = term["wave_number_k"], term["sine_k"], term["cosine_k"]
            yield TorqueTerm(self.waves, values, friction=True, dry=True)
