"""An encoder disc off its centre."""

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.effects.effect import Effect, JointScale, OperatingRange, Place, Shape, number
from idim_iv_ros.types import FloatArray

_NAMES = ("sine", "cosine", "sine_2", "cosine_2")
_TYPICAL = 0.002  # rad, of 0.01 to 5 mrad
_LEAST_TURN = 0.5  # rad


class EncoderEccentricity(Effect):
    """q_measured = q + sine sin q + cosine cos q (+ twice a turn); shape: 1 or 2 terms.

    The model is evaluated at the wrong position: to first order all torques move.

    Simulated by `simulation.effect_kernel.measure`.
    """

    name = "encoder_eccentricity"
    order = 140
    family = "position"
    confounders = ("spring", "position_ripple")
    excitation = "fast full turns, or a second encoder on the link"

    def grid(self, place: Place, covered: OperatingRange) -> list[Shape]:
        """Once, or once and twice a turn."""
        return [(1.0,), (2.0,)]

    def neighbours(
        self, shape: Shape, step: float, place: Place, covered: OperatingRange
    ) -> list[Shape]:
        """None."""
        return []

    def free_numbers(self, shape: Shape) -> int:
        """See the grid."""
        return 0

    def cannot_show(self, joint: int, covered: OperatingRange) -> str:
        """It needs a good part of a turn."""
        span, length = covered.span(joint), covered.length(joint)
        if length == "rad" and span >= _LEAST_TURN:
            return ""
        return f"the joint moves {span:.2g} {length}: an error of once a turn looks constant"

    def columns(self, motion: SmoothMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        """See the class."""
        q = motion.position[:, place.joint]
        small = 1e-4
        errors = [np.sin(q), np.cos(q)]
        if shape[0] == 2.0:
            errors += [np.sin(2 * q), np.cos(2 * q)]
        parts = [motion.moved(place.joint, -small * e, links=False) / small for e in errors]
        return {
            joint: np.column_stack([part[:, joint] for part in parts])
            for joint in range(motion.position.shape[1])
        }

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        """Small errors only: no disc is further out than 50 mrad."""
        return bool(np.max(np.abs(coefficients)) < 0.05)

    def plausible(
        self, shape: Shape, coefficients: FloatArray, torque: float, scale: JointScale
    ) -> bool:
        """Amplitudes up to the middle of what encoders have."""
        return bool(np.max(np.abs(coefficients)) <= _TYPICAL)

    def parameters(
        self, shape: Shape, coefficients: FloatArray, deviations: FloatArray
    ) -> dict[str, EffectParameter]:
        """Amplitudes."""
        return {
            name: number(coefficients[k], deviations[k], "rad")
            for k, name in enumerate(_NAMES[: len(coefficients)])
        }
