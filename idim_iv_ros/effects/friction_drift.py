"""Friction that changes during the session: warm-up."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw
from idim_iv_ros.effects.effect import JointRange, Place, Shape, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_QUICKEST = 3.0  # s: a joint that cools within less has no mass that friction warms
_LEAST_OF_RECORDING = 0.25  # time constant of a joint that its motion warms, at least
_MIDDLE = 0.5  # warmth of the nominal friction, with which the search by the motion begins


@dataclass(frozen=True)
class DriftShape(Shape):
    """How friction fades."""

    time_constant: float  # s
    # Whether the clock restarts with each recording, as where a robot rests in between; else it
    # runs through the session
    restarts: bool
    # Mean of the joint's that keeps it warm, rad/s (m/s); 0 where time warms it, however it moves
    speed: float = 0.0
    nominal: float = 1.0  # Warmth at which friction is that of the model, 0 cold to 1 warm


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Values: time constant, coulomb, viscous, restarts, speed, nominal warmth.

    State: warmth beyond that by the clock.
    """
    left = math.exp(-(at.elapsed if p[3] == 1.0 else at.time) / p[0]) - state[0] + p[5] - 1.0
    return Torque(left * p[1], left * p[2], 0.0, 0.0)


@kernel
def _advance(p: FloatArray, state: FloatArray, dq: float, ddq: float, step: float) -> None:
    """Warm the joint by its speed beyond the mean, exactly for a speed that is constant in a step.

    The values are those of `_torque`.
    """
    if p[4] > 0.0:
        state[0] += -math.expm1(-step / p[0]) * (abs(dq) / p[4] - 1.0 - state[0])


class FrictionDrift(StructuralEffect[DriftShape]):
    """(nominal − w) (coulomb sign(dq) + viscous dq), time_constant · dw/dt = ∣dq∣ / speed − w.

    Friction warms the joint as it moves: w is its warmth. What is dissipated goes with ∣dq∣ where
    dry friction prevails. At a steady speed, and where `speed` is 0, w = 1 − exp(−t /
    time_constant), t of the session or of the recording; a recording starts as warm as that.
    Nominal numbers are those of some warmth: that of a robot that has run for long, or another.
    """

    name = "friction_drift"
    order = 60
    part = "friction"
    family = "time"
    linear = ("coulomb", "viscous")
    dry = True
    signed = True  # friction may fall or rise
    excitation = "one motion repeated at the start, in the middle and at the end of the session"
    segments = ("repeat",)
    typical = ShareOf("dry friction", 0.4)  # 30 to 60 %
    specs = (
        ParameterSpec("time_constant", "s", default=None, bound="positive"),
        ParameterSpec("coulomb", "N m", "loss of Coulomb friction from cold to warm"),
        ParameterSpec("viscous", "N m s/rad", "loss of viscous friction from cold to warm"),
        ParameterSpec(
            "restarts", "", "clock that starts anew with each recording (1) or not (0)",
            bound="0 or 1",
        ),
        ParameterSpec(
            "speed", "rad/s", "mean speed that keeps the joint warm; 0: time alone warms it",
            bound="not negative",
        ),
        ParameterSpec(
            "nominal", "", "warmth at which friction is the model's: 0 cold, 1 warm", 1.0
        ),
    )  # fmt: skip
    fixed = ("speed",)
    ends: ClassVar = {"nominal": (0.05, 1.5)}
    laws = (TorqueLaw(_torque, _advance),)

    def grid(self, covered: JointRange) -> list[DriftShape]:
        """From a twentieth of the session to three of it, which is a straight line, or from 3 s on.

        Of several recordings also from a tenth of the longest to three of it, anew in each. By
        time alone, and by the motion; where a quick warmth would follow the speed itself.
        """
        session = np.geomspace(0.05 * covered.duration, 3.0 * covered.duration, 8)
        recording = np.geomspace(0.1 * covered.longest, 3.0 * covered.longest, 7)
        several = covered.longest < covered.duration
        clocks = [(time, False) for time in session if time >= _QUICKEST]
        clocks += [(time, True) for time in recording if several and time >= _QUICKEST]
        speed = covered.mean_speed
        quickest = _LEAST_OF_RECORDING * covered.longest
        return [
            *(DriftShape(float(time), anew) for time, anew in clocks),
            *(DriftShape(float(t), anew, speed, _MIDDLE) for t, anew in clocks if t >= quickest),
        ]

    def columns(self, motion: RobotMotion, place: Place, shape: DriftShape) -> Torques:
        """Dry and viscous friction of unit size, times what the warmth leaves of it."""
        v = motion.velocity[:, place.joint]
        fading = np.exp(-(motion.elapsed if shape.restarts else motion.time) / shape.time_constant)
        if shape.speed > 0.0:
            kept = math.exp(-1.0 / (motion.rate * shape.time_constant))
            fading -= scipy.signal.lfilter(
                [0.0, 1.0 - kept], [1.0, -kept], np.abs(v) / shape.speed - 1.0
            )
        fading += shape.nominal - 1.0
        return {place.joint: fading[:, None] * np.column_stack([motion.slip[:, place.joint], v])}

    def meaning(self, shape: DriftShape) -> str:
        """What warms the joint, and whether that runs through the session, in words."""
        by = "by its motion, " if shape.speed > 0.0 else ""
        return by + ("anew in each recording" if shape.restarts else "through the session")
