"""A torque that acts later than its command."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, JointScale, OperatingRange, Place, Shape, number
from idim_iv_ros.types import FloatArray

_TERMS = 3  # of the Taylor series: the rows end where 2π f delay is about one
_DELAYS = (0.0003, 0.0006, 0.001, 0.002, 0.004, 0.008, 0.012)
_TYPICAL_DELAY = 0.002  # s, of 0.25 to 20 ms


class TimeDelay(Effect):
    """The logged command leads the torque by `delay`: τ(t + delay) − τ(t); shape: delay, s.

    The slow current loop of a drive is the same to first order.

    Simulated by `simulation.effect_signals.delays`.
    """

    name = "time_delay"
    order = 100
    family = "frequency"
    confounders = ("elasticity", "nonlinear_viscous")
    of_high_derivatives = True
    excitation = "energy above 2 Hz and sharp reversals"
    size_in = "scale"

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """From 0.3 to 12 ms."""
        return [(delay,) for delay in _DELAYS]

    def free_numbers(self, shape: Shape) -> int:
        """None: for short delays only their product with the coefficient counts."""
        return 0

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """Delays down to a tenth of a millisecond."""
        near = super().neighbours(shape, step, place, covered)
        return [(max(delay, 1e-4),) for (delay,) in near]

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        torque = motion.torque[:, place.joint]
        change = np.zeros_like(torque)
        term, factor = torque, 1.0
        # Central differences: where friction jumps, interpolation between samples would ring.
        for order in range(1, _TERMS + 1):
            term, factor = np.gradient(term, 1.0 / motion.rate), factor * shape[0] / order
            change += factor * term
        return {place.joint: change[:, None]}

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """The whole torque is late, not a part of it (the shape bends with longer delays)."""
        return bool(0.4 < coefficients[0] < 2.5)

    def settled(self, shape: Shape, coefficients: FloatArray) -> Shape:
        """The delay that both make; its whole torque is then late."""
        delay = float(shape[0] * coefficients[0])
        return (delay,) if _DELAYS[0] <= delay <= _DELAYS[-1] else shape

    def plausible(
        self, shape: Shape, coefficients: FloatArray, torque: float, scale: JointScale
    ) -> bool:
        """Delays up to the middle of what drives have."""
        return bool(shape[0] * coefficients[0] <= _TYPICAL_DELAY)

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """The delay, to first order: shape times coefficient."""
        return {"delay": number(shape[0] * coefficients[0], shape[0] * deviations[0], "s")}
