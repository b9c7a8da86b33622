"""What is compared and is no effect of the catalogue: free curves, and errors of the signals.

Where a flexible function of one family explains the residual better than any effect of the
catalogue, in spite of its many coefficients, the cause is not in the catalogue: it is described
instead of misnamed. Errors of the recording or of the mounting move the torque all the same: they
are looked for beside the effects, so that none is named for them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.effects.cause import Family
from idim_iv_ros.effects.effect import Effect, JointRange, Place, Shape
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.effects.waves import WaveEffect, Waves
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray

_STOP_RANGE = 0.4  # of the joint's range, from either end, in which a contact is looked for
_LONGEST_SHIFT = 0.02  # s
# Weight at a joint, as a share of that at the others, below which its axis is vertical.
_NO_WEIGHT = 1e-6
_LARGEST_RIPPLE = 0.1  # of the gain


@dataclass(frozen=True)
class Knots(Shape):
    """Values of a variable between which a curve is straight."""

    values: tuple[float, ...]


@dataclass(frozen=True)
class StopShape(Shape):
    """Position of a stop, rad (m), above which (side 1) or below which (−1) it acts."""

    side: float
    position: float


class Unnamed(Effect):
    """What is compared and is no effect of the catalogue; its coefficients are no numbers of it."""

    excitation = ""
    signed = True


class Nonparametric(Unnamed):
    """A family of functions; its coefficients mean nothing to an engineer."""

    words: str


_KNOTS: dict[str, Callable[[JointRange], FloatArray]] = {
    "velocity": lambda covered: np.append(0.0, np.geomspace(covered.slowest, covered.fastest, 7)),
    "position": lambda covered: np.linspace(covered.low, covered.high, 9),
    "load": lambda covered: np.linspace(0.0, covered.load, 6),
    "torque": lambda covered: np.linspace(0.0, covered.torque, 7),
    "time": lambda covered: np.linspace(0.0, covered.duration, 6),
}


class Curve(Nonparametric):
    """Σ of hat functions of a variable, times a weight; shape: the knots.

    `variable`: of the motion, but for position and time its modulus; `weight`: of the motion, too;
    one, or the sign of the torque (side).
    """

    fixed = ("values",)

    def __init__(self, name: str, family: Family, words: str, variable: str, weight: str) -> None:
        self.name = name  # type: ignore[misc]
        self.family = family  # type: ignore[misc]
        self.part = "friction" if weight in ("slip", "velocity") else ""  # type: ignore[misc]
        self.words, self._variable, self._weight = words, variable, weight

    def grid(self, covered: JointRange) -> list[Shape]:
        """One set of knots."""
        knots = _KNOTS[self._variable](covered)
        return [Knots(tuple(map(float, knots)))] if np.all(np.diff(knots) > 0.0) else []

    def columns(self, motion: RobotMotion, place: Place, shape: Knots) -> Torques:
        """Hat functions at the knots."""
        values = getattr(motion, self._variable)
        if self._variable != "time":
            values = values[:, place.joint]
            values = values if self._variable == "position" else np.abs(values)
        hats = [np.interp(values, shape.values, row) for row in np.eye(len(shape.values))]
        weight = np.ones(len(values))
        if self._weight == "side":
            weight = np.sign(motion.torque[:, place.joint])
        elif self._weight != "one":
            weight = getattr(motion, self._weight)[:, place.joint]
        return {place.joint: np.column_stack(hats) * weight[:, None]}


class Stop(Nonparametric):
    """Torque that sets in beyond a position, elastic and damped; shape: side, position."""

    name = "contact beyond a position"
    family = "position"
    words = "sets in beyond one position and resists further motion"

    def grid(self, covered: JointRange) -> list[Shape]:
        """Positions near either end of the range."""
        low, high = covered.low, covered.high
        length = _STOP_RANGE * (high - low)
        if high <= low:
            return []
        upper = np.linspace(high - length, high - 0.02 * length, 25)
        lower = np.linspace(low + 0.02 * length, low + length, 25)
        return [StopShape(side, float(p)) for side, ps in ((1.0, upper), (-1.0, lower)) for p in ps]

    def neighbours(self, shape: StopShape, step: float, covered: JointRange) -> list[Shape]:
        """Nearby positions."""
        move = 0.05 * step * covered.span
        return [replace(shape, position=shape.position + sign * move) for sign in (1.0, -1.0)]

    def columns(self, motion: RobotMotion, place: Place, shape: StopShape) -> Torques:
        """Spring and damper beyond the position."""
        side, start = shape.side, shape.position
        beyond = np.maximum(side * (motion.position[:, place.joint] - start), 0.0)
        inside = beyond > 0.0
        v = motion.velocity[:, place.joint]
        return {place.joint: np.column_stack([side * beyond, inside * v, beyond * v])}


class Lags(Nonparametric):
    """First three derivatives of the joint's torque: any linear dynamics, to third order."""

    name = "dynamics of the torque"
    family = "frequency"
    words = "follows the torque's rate of change"

    def columns(self, motion: RobotMotion, place: Place, shape: Shape) -> Torques:
        """Derivatives of the joint's torque, first to third."""
        rows = [motion.torque[:, place.joint]]
        for _ in range(3):
            rows.append(np.gradient(rows[-1], 1.0 / motion.rate))
        return {place.joint: np.column_stack(rows[1:])}


# Name, family, words, variable, weight.
_CURVES: tuple[tuple[str, Family, str, str, str], ...] = (
    ("friction over speed", "velocity", "is a friction that depends on the speed",
     "velocity", "slip"),
    ("difference of directions over speed", "velocity",
     "differs between the directions and depends on the speed", "velocity", "one"),
    ("torque over position", "position", "depends on the position, the same in both directions",
     "position", "one"),
    ("friction over position", "position", "is a friction that depends on the position",
     "position", "slip"),
    ("friction over load", "load", "is a friction that depends on the load", "load", "slip"),
    ("torque over torque", "load", "depends on the motor's torque", "torque", "side"),
    ("dry friction over time", "time", "is a dry friction that changes during the session",
     "time", "slip"),
    ("viscous friction over time", "time", "is a viscous friction that changes during the session",
     "time", "velocity"),
)  # fmt: skip
NONPARAMETRIC: tuple[Nonparametric, ...] = (
    *(Curve(*row) for row in _CURVES),
    Stop(),
    Lags(),
)


class TiltedMoments(Unnamed):
    """First moments about the first joint of a base that is tilted.

    About a vertical axis gravity does not show them, so that no base parameter holds them; under a
    tilt they turn with the joint. Nothing without a tilt: they are looked for beside it alone.
    """

    name = "first_moments_under_tilt"
    family: ClassVar[Family] = "load"
    acts_with = "gravity"

    def places(self, joints: int) -> list[Place]:
        """One place: the first joint."""
        return [Place(0)]

    def columns(self, motion: RobotMotion, place: Place, shape: Shape) -> Torques:
        """Cosine and sine of the first joint's position; zero where gravity shows them."""
        still = np.zeros_like(motion.position)
        weight = inverse_dynamics(motion.robot, motion.links, motion.position, still, still)
        position = motion.position[:, 0]
        turning = np.column_stack([np.cos(position), np.sin(position)])
        upright = np.abs(weight[:, 0]).max() < _NO_WEIGHT * max(np.abs(weight).max(), 1e-300)
        return {0: turning if upright else np.zeros_like(turning)}


class CommonShift(Unnamed):
    """An effort that is late at all joints by what effects hid when it was aligned.

    A soft shaft or a coupling changes the shift that is estimated without it. What remains is of
    the recording, and no delay of one joint: beside this, a delay must be a joint's own.
    """

    name = "effort_shift"
    family: ClassVar[Family] = "frequency"

    def places(self, joints: int) -> list[Place]:
        """One place: all joints, where there are several."""
        return [Place(0)] if joints > 1 else []

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Early or late by what a few periods of a slow control make."""
        return bool(np.all(np.abs(coefficients) < _LONGEST_SHIFT))

    def columns(self, motion: RobotMotion, place: Place, shape: Shape) -> Torques:
        """Rate of change of every joint's torque, N m/s."""
        rates = np.asarray(np.gradient(motion.torque, 1.0 / motion.rate, axis=0))
        return {joint: rates[:, [joint]] for joint in range(motion.torque.shape[1])}


class GainRipple(WaveEffect, Unnamed):
    """An effort whose gain ripples over the position: the torque times 1 + Σ a sin n q + b cos n q.

    Slots, poles and the sensors of the phase currents make the torque of a unit current depend on
    the rotor's angle. It looks like a torque that ripples, but grows with the torque, and no robot
    that is simulated in N m has it.
    """

    name = "gain_ripple"
    family: ClassVar[Family] = "position"

    def torques(self, motion: RobotMotion, place: Place, shapes: Sequence[Waves]) -> list[Torques]:
        """Torque of the joint times sine and cosine of each wave."""
        torque = motion.torque[:, [place.joint]]
        waves = super().torques(motion, place, shapes)
        return [{joint: columns * torque for joint, columns in wave.items()} for wave in waves]

    def admissible(self, shape: Waves, coefficients: FloatArray) -> bool:
        """Amplitudes that sensors and motors have."""
        return bool(np.all(np.abs(coefficients) < _LARGEST_RIPPLE))

    def note(self, joint: str, shape: Shape, values: FloatArray, deviations: FloatArray) -> str:
        """What a report says of its first wave, beside the causes."""
        size = float(np.hypot(*values[:2]))
        deviation = float(np.hypot(*(values[:2] * deviations[:2]))) / max(size, 1e-300)
        percent, half = 100.0 * size, 100.0 * settings.NORMAL_95 * deviation
        return (
            f"the gain of the effort of {joint} ripples over the position by {percent:.2g} ± "
            f"{half:.1g} %, {shape.numbers[0]:.4g} rad of phase for each rad (m) of the joint: a "
            "property of the measured effort, on which no cause is built"
        )


SIGNALS: tuple[Unnamed, ...] = (CommonShift(), TiltedMoments(), GainRipple())
