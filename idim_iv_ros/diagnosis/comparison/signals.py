"""What is no effect and no number, and moves the torque of a recording all the same.

It is looked for beside the effects, so that none is named for it.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.effects.cause import Family
from idim_iv_ros.effects.effect import Effect, Place, Shape
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.effects.waves import WaveEffect, Waves
from idim_iv_ros.simulation import inverse_dynamics
from idim_iv_ros.types import FloatArray

_LONGEST_SHIFT = 0.02  # s
# Weight at a joint, as a share of that at the others, below which its axis is vertical.
_NO_WEIGHT = 1e-6
_LARGEST_RIPPLE = 0.1  # of the gain


class Unnamed(Effect):
    """What is compared and is no effect of the catalogue; its coefficients are no numbers of it."""

    excitation = ""
    signed = True


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
