"""Torque that ripples with the position: cogging, teeth, ripple of the motor's current."""

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape, ShareOf
from idim_iv_ros.effects.waves import (
    MOST_WAVES,
    near_waves,
    wave_numbers,
    wave_parameters,
    waves,
)
from idim_iv_ros.types import FloatArray

_PERIODS = 2.5  # in the range of the joint, at least: fewer are a spring


class PositionRipple(Effect):
    """Σ sine_k sin(n_k q) + cosine_k cos(n_k q), the same in both directions; shape: n_k.

    Simulated by `simulation.effect_kernel.effect_torques`.
    """

    name = "position_ripple"
    order = 120
    family = "position"
    confounders = ("spring", "position_dependent_friction")
    excitation = "slow constant speed over many periods, in both directions"
    typical = ShareOf("peak", 0.015)  # 0.5 to 3 %

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """One wave."""
        return [(float(n),) for n in wave_numbers(place, covered, _PERIODS)]

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """Nearby wave numbers."""
        return near_waves(shape, step, covered.span(place.joint))

    def longer(self, shape: Shape, place: Place, covered: OperatingRange) -> list[Shape]:
        """One wave more."""
        if len(shape) >= MOST_WAVES:
            return []
        return [(*shape, float(n)) for n in wave_numbers(place, covered, _PERIODS)]

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        return {place.joint: waves(motion.position[:, place.joint], shape)}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Any phase."""
        return True

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Wave numbers and amplitudes."""
        return wave_parameters(shape, coefficients, deviations)
