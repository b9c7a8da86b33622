"""Pre-sliding: dry friction that builds up over a small displacement after a reversal."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numba import njit

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import GivenNumbers, ParameterSpec
from idim_iv_ros.effects.contribution import Instant, Torque, TorqueLaw, TorqueTerm
from idim_iv_ros.effects.effect import JointRange, Place, Shape, ShareOf, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_LEAST_ROWS = 0.25
_ROWS_AT_REVERSAL = 2.0  # that tell nothing where it is not known when a joint sticks


@dataclass(frozen=True)
class BristleShape(Shape):
    """Distances after which the bristles slip, rad (m)."""

    spans: tuple[float, ...]


@njit(cache=True)
def bristle(position: FloatArray, span: float) -> FloatArray:
    """Deflection (s,) of a Maxwell-slip element, −1 to 1, at rest at the start."""
    deflection = np.zeros(len(position))
    for k in range(1, len(position)):
        value = deflection[k - 1] + (position[k] - position[k - 1]) / span
        deflection[k] = min(max(value, -1.0), 1.0)
    return deflection


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Values: span, level; state: deflection, direction in which it slides or 0 while it bends."""
    if state[1] != 0.0:
        return Torque(0.0, 0.0, p[1] * state[1], 0.0)
    bent = state[0] + 0.5 * at.step * at.velocity / p[0]
    return Torque(0.0, 0.0, p[1] * bent, p[1] / p[0])


@kernel
def _advance(p: FloatArray, state: FloatArray, dq: float, ddq: float, step: float) -> None:
    bent = min(max(state[0] + step * (dq + 0.5 * step * ddq) / p[0], -1.0), 1.0)
    state[0] = bent
    outward = abs(bent) == 1.0 and bent * (dq + step * ddq) > 0.0
    state[1] = bent if outward else 0.0


@kernel
def _turns(p: FloatArray, state: FloatArray, dq: float, ddq: float, step: float) -> bool:
    """Whether bristles taken to bend slide by the middle of this step, or sliding ones turned back.

    `state` then holds what they do instead, and the step is computed again. Bristles are stiffer
    than any prediction of where they will be.
    """
    moved = 0.5 * step * (dq + 0.5 * step * ddq) / p[0]
    if state[1] == 0.0 and abs(state[0] + moved) > 1.0:
        state[1] = np.sign(state[0] + moved)
        return True
    if state[1] * moved < 0.0:
        state[1] = 0.0
        return True
    return False


class Presliding(StructuralEffect[BristleShape]):
    """Σ level_k (z_k − sign(dq)), z_k a bristle that slips after span_k.

    Replaces as much of the Coulomb friction by springs that slip (Maxwell-slip).
    """

    name = "presliding"
    order = 70
    lost_where_softened = True
    part = "friction"
    family = "velocity"
    linear = ("level_k",)
    excitation = "many small reversals of different sizes, at different rates"
    segments = ("reversals",)
    typical = ShareOf("dry friction", 0.5)
    specs = (
        ParameterSpec("span_k", "rad", "distance to full slip", None, "positive"),
        ParameterSpec("level_k", "N m", "part of the Coulomb friction", None, "not negative"),
    )
    law = TorqueLaw(_torque, _advance, _turns)
    laws = (law,)

    def grid(self, covered: JointRange) -> list[BristleShape]:
        """Spans from what a reversal crosses within a part of a row to 0.15 of the range.

        Shorter ones cannot be told from a joint that turns a row earlier or later.
        """
        span = covered.span
        if span <= 0.0:
            return []
        acceleration = 2.0 * covered.fastest**2 / span
        rows = _LEAST_ROWS if covered.sticking else _ROWS_AT_REVERSAL
        least = max(1e-4 * covered.lever, 0.5 * acceleration * (rows / covered.row_rate) ** 2)
        spans = np.geomspace(least, max(0.15 * span, 10.0 * least), 16)
        return [BristleShape((float(span),)) for span in spans]

    def columns(self, motion: RobotMotion, place: Place, shape: BristleShape) -> Torques:
        """Each bristle less the dry friction that it replaces."""
        q = np.ascontiguousarray(motion.position[:, place.joint])
        sign = motion.slip[:, place.joint]
        return {place.joint: np.column_stack([bristle(q, span) - sign for span in shape.spans])}

    def contributions(self, given: GivenNumbers) -> Iterator[TorqueTerm]:
        """Bristles in the place of Coulomb friction, which they cannot exceed."""
        total = sum(term["level_k"] for term in given.terms)
        part = min(1.0, max(given.coulomb, 0.0) / total) if total else 0.0
        for term in given.terms:
            level = part * term["level_k"]
            yield TorqueTerm(self.law, (term["span_k"], level), friction=True, replaced=level)
