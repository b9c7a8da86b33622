"""Torque that ripples with the position: cogging, teeth, ripple of the motor's current."""

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw
from idim_iv_ros.effects.effect import ShareOf
from idim_iv_ros.effects.waves import WaveEffect, wave, wave_specs
from idim_iv_ros.types import FloatArray


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    return Torque(0.0, 0.0, wave(p, at.position), 0.0)


class PositionRipple(WaveEffect):
    """Σ sine_k sin(n_k q) + cosine_k cos(n_k q), the same in both directions."""

    name = "position_ripple"
    order = 120
    family = "position"
    signed = True
    excitation = "slow constant speed over many periods, in both directions"
    segments = ("range_sweep",)
    typical = ShareOf("peak", 0.015)  # 0.5 to 3 %
    specs = wave_specs("torque")
    laws = (TorqueLaw(_torque),)
