"""An encoder disc off its centre."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.contribution import EncoderLaw
from idim_iv_ros.effects.effect import JointRange, Place, Shape, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_NAMES = ("sine", "cosine", "sine_2", "cosine_2")
_LEAST_TURN = 0.5  # rad


@dataclass(frozen=True)
class DiscShape(Shape):
    """Whether the error has a part of two periods a turn."""

    twice: bool


@kernel
def _error(p: FloatArray, q: float) -> tuple[float, float]:
    """Error of the encoder from the parameters p = (sine, cosine, sine_2, cosine_2)."""
    s1, c1, s2, c2 = np.sin(q), np.cos(q), np.sin(2.0 * q), np.cos(2.0 * q)
    error = p[0] * s1 + p[1] * c1 + p[2] * s2 + p[3] * c2
    return error, p[0] * c1 - p[1] * s1 + 2.0 * (p[2] * c2 - p[3] * s2)


class EncoderEccentricity(StructuralEffect[DiscShape]):
    """q_measured = q + sine sin q + cosine cos q (+ twice a turn).

    The model is evaluated at the wrong position: to first order all torques move.
    """

    name = "encoder_eccentricity"
    order = 140
    family = "position"
    typical = 0.002  # rad, of 0.01 to 5 mrad
    linear = _NAMES
    excitation = "fast full turns, or a second encoder on the link"
    segments = ("range_sweep",)
    specs = tuple(
        ParameterSpec(name, "rad", f"encoder error with {words}")
        for name, words in zip(_NAMES, ("sin q", "cos q", "sin 2q", "cos 2q"), strict=True)
    )
    laws = (EncoderLaw(_error),)

    def grid(self, covered: JointRange) -> list[DiscShape]:
        """Shapes with one period a turn, and with one and two."""
        return [DiscShape(False), DiscShape(True)]

    def cannot_show(self, covered: JointRange) -> str:
        """Why a joint turns too little to show the effect; empty if it turns enough."""
        span, length = covered.span, covered.length
        if length == "rad" and span >= _LEAST_TURN:
            return ""
        return f"the joint moves {span:.2g} {length}: an error of once a turn looks constant"

    def torques(
        self, motion: RobotMotion, place: Place, shapes: Sequence[DiscShape]
    ) -> list[Torques]:
        """Change of all torques by every part of the error, 1 rad large; shared parts once."""
        q = motion.position[:, place.joint]
        small = 1e-4
        errors = [np.sin(q), np.cos(q)]
        if any(shape.twice for shape in shapes):
            errors += [np.sin(2 * q), np.cos(2 * q)]
        parts = [motion.moved(place.joint, -small * e, links=False) / small for e in errors]
        tables = np.stack(parts, axis=2)  # (s, n_joints, parts)
        joints = range(tables.shape[1])
        return [{j: tables[:, j, : 4 if shape.twice else 2] for j in joints} for shape in shapes]

    def admissible(self, shape: DiscShape, coefficients: FloatArray) -> bool:
        """Small errors only: no disc is further out than 50 mrad."""
        return bool(np.max(np.abs(coefficients)) < 0.05)
