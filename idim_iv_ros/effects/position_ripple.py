"""Torque that ripples with the position: cogging, teeth, ripple of the motor's current."""

from collections.abc import Sequence

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import EffectParameter, GivenNumbers
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw, TorqueTerm
from idim_iv_ros.effects.effect import OperatingRange, Place, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion
from idim_iv_ros.effects.waves import (
    Waves,
    near_waves,
    one_wave_more,
    wave,
    wave_columns,
    wave_grid,
    wave_parameters,
    wave_specs,
    wave_values,
)
from idim_iv_ros.types import FloatArray

_PERIODS = 2.5  # in the range of the joint, at least: fewer are a spring


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    return Torque(0.0, 0.0, wave(p, at.position), 0.0)


_LAW = TorqueLaw(_torque)


class PositionRipple(StructuralEffect[Waves]):
    """Σ sine_k sin(n_k q) + cosine_k cos(n_k q), the same in both directions."""

    name = "position_ripple"
    order = 120
    family = "position"
    confounders = ("spring", "position_dependent_friction")
    excitation = "slow constant speed over many periods, in both directions"
    segments = ("range_sweep",)
    typical = ShareOf("peak", 0.015)  # 0.5 to 3 %
    specs = wave_specs("torque")
    laws = (_LAW,)

    def grid(self, place: Place, covered: OperatingRange) -> list[Waves]:
        """One wave."""
        return wave_grid(place, covered, _PERIODS)

    def neighbours(
        self, shape: Waves, step: float, place: Place, covered: OperatingRange
    ) -> list[Waves]:
        """Nearby wave numbers."""
        return near_waves(shape, step, covered.span(place.joint))

    def longer(
        self, shape: Waves, place: Place, covered: OperatingRange
    ) -> list[tuple[Waves, Waves]]:
        """One wave more."""
        return one_wave_more(shape, self.grid(place, covered))

    def columns(self, motion: RobotMotion, place: Place, shape: Waves) -> dict[int, FloatArray]:
        """Sine and cosine of each wave."""
        return self.torques(motion, place, [shape])[0]

    def torques(
        self, motion: RobotMotion, place: Place, shapes: Sequence[Waves]
    ) -> list[dict[int, FloatArray]]:
        """The same of many waves."""
        made = wave_columns(motion.position[:, place.joint], shapes)
        return [{place.joint: columns} for columns in made]

    def admissible(self, shape: Waves, coefficients: FloatArray) -> bool:
        """Any phase."""
        return True

    def parameters(
        self, shape: Waves, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Wave numbers and amplitudes."""
        return self.numbers(**wave_parameters(shape, coefficients, deviations))

    def contributions(self, given: GivenNumbers) -> list[TorqueTerm]:
        """A torque for each wave."""
        return [TorqueTerm(_LAW, values) for values in wave_values(given)]
