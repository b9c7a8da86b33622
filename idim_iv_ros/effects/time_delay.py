"""A torque that acts later than its command."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from idim_iv_ros.effects.cause import GivenNumbers, Parameters, ParameterSpec
from idim_iv_ros.effects.contribution import CommandDelay
from idim_iv_ros.effects.effect import JointRange, Place, Shape, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_TERMS = 3  # of the Taylor series: the rows end where 2π f delay is about one
_DELAYS = (0.0003, 0.0006, 0.001, 0.002, 0.004, 0.008, 0.012)
_LONGEST = 0.02  # s


@dataclass(frozen=True)
class DelayShape(Shape):
    """Delay of the torque, s."""

    delay: float


class TimeDelay(StructuralEffect[DelayShape]):
    """The logged command leads the torque by `delay`: τ(t + delay) − τ(t).

    The slow current loop of a drive is the same to first order.
    """

    name = "time_delay"
    order = 100
    put_in_first = True
    part = "delay"
    family = "frequency"
    typical = 0.002  # s, of 0.25 to 20 ms
    ends: ClassVar = {"delay": (1e-4, np.inf)}
    excitation = "energy above 2 Hz and sharp reversals"
    segments = ("multisine",)
    size_in = "scale"
    specs = (ParameterSpec("delay", "s", "delay of the torque", bound="not negative"),)
    everywhere = True

    def grid(self, covered: JointRange) -> list[DelayShape]:
        """Delays from 0.3 to 12 ms."""
        return [DelayShape(delay) for delay in _DELAYS]

    def columns(self, motion: RobotMotion, place: Place, shape: DelayShape) -> Torques:
        """Change of the torque by the delay, as a Taylor series."""
        torque = motion.torque[:, place.joint]
        change = np.zeros_like(torque)
        term, factor = torque, 1.0
        # Central differences: where friction jumps, interpolation between samples would ring.
        for order in range(1, _TERMS + 1):
            term, factor = np.gradient(term, 1.0 / motion.rate), factor * shape.delay / order
            change += factor * term
        return {place.joint: change[:, None]}

    def admissible(self, shape: DelayShape, coefficients: FloatArray) -> bool:
        """The whole torque is late, not a part of it; short shapes times much are slow loops."""
        return bool(coefficients[0] > 0.4)

    def impossible(self, shape: DelayShape, coefficients: FloatArray, covered: JointRange) -> str:
        """Why a delay is longer than any drive's; empty if it is not."""
        delay = float(shape.delay * coefficients[0])
        longest = 1e3 * _LONGEST
        return "" if delay <= _LONGEST else f"{1e3 * delay:.2g} ms are beyond {longest:.0f} ms"

    def parameters(
        self, shape: DelayShape, coefficients: FloatArray, deviations: FloatArray
    ) -> Parameters:
        """The delay, to first order: shape times coefficient."""
        return self.numbers(delay=(shape.delay * coefficients[0], shape.delay * deviations[0]))

    def contributions(self, given: GivenNumbers) -> list[CommandDelay]:
        """A command that arrives later."""
        return [CommandDelay(given.value["delay"])]
