"""Dry friction that depends on the position: a bent shaft, a worn or tight spot."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape, ShareOf, number
from idim_iv_ros.effects.waves import (
    MOST_WAVES,
    near_waves,
    wave_numbers,
    wave_parameters,
    waves,
)
from idim_iv_ros.types import FloatArray

_PERIODS = 0.7  # in the range of the joint, at least
_BEYOND = 0.2  # of the range: a spot may lie outside, its flank inside
_SPOT = -1.0  # first number of the shape of a tight spot; wave numbers are positive


class PositionDependentFriction(Effect):
    """sign(dq) · (waves of the position, or height · exp(−((q − centre) / width)²)).

    Shape: wave numbers n_k, or −1, centre, width of a tight spot.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "position_dependent_friction"
    order = 50
    family = "position"
    confounders = ("load_dependent_friction", "position_ripple")
    excitation = "the same places in both directions, slowly"
    typical = ShareOf("dry friction", 0.1)  # 5 to 15 %

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """One wave, or one spot."""
        low, high = covered.low[place.joint], covered.high[place.joint]
        span = float(high - low)
        if span <= 0.0:
            return []
        spots: list[Shape] = [
            (_SPOT, float(centre), width * span)
            for width in (0.06, 0.15, 0.35)
            for centre in np.linspace(low - _BEYOND * span, high + _BEYOND * span, 31)
            if low - width * span < centre < high + width * span
        ]
        waves_: list[Shape] = [(float(n),) for n in wave_numbers(place, covered, _PERIODS)]
        return waves_ + spots

    def branches(self, grid: list[Shape]) -> list[list[Shape]]:
        """Waves and spots: one wave may fit worse than a spot, and two better."""
        spots = [shape for shape in grid if shape[0] == _SPOT]
        return [[shape for shape in grid if shape[0] != _SPOT], spots]

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """Nearby wave numbers, centres and widths."""
        if shape[0] != _SPOT:
            return near_waves(shape, step, covered.span(place.joint))
        _, centre, width = shape
        moved: list[Shape] = [(_SPOT, centre + sign * step * width, width) for sign in (1.0, -1.0)]
        moved += [(_SPOT, centre, width * (1 + step)), (_SPOT, centre, width / (1 + step))]
        low, high = (
            float(covered.low[place.joint]),
            float(covered.high[place.joint]),
        )
        return [each for each in moved if low - each[2] < each[1] < high + each[2]]

    def longer(self, shape: Shape, place: Place, covered: OperatingRange) -> list[Shape]:
        """One wave more."""
        if shape[0] == _SPOT or len(shape) >= MOST_WAVES:
            return []
        return [(*shape, float(n)) for n in wave_numbers(place, covered, _PERIODS)]

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        q = motion.position[:, place.joint]
        sign = motion.slip[:, place.joint]
        if shape[0] == _SPOT:
            _, centre, width = shape
            return {place.joint: (np.exp(-(((q - centre) / width) ** 2)) * sign)[:, None]}
        return {place.joint: waves(q, shape) * sign[:, None]}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Any phase; a spot may be tight or loose."""
        return True

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Wave numbers and amplitudes, or place, width and height of the spot."""
        if shape[0] != _SPOT:
            return wave_parameters(shape, coefficients, deviations)
        return {
            "centre": number(shape[1], None, "rad"),
            "width": number(shape[2], None, "rad"),
            "height": number(coefficients[0], deviations[0], "N m"),
        }
