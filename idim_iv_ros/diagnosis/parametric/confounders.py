"""Structural effects that pass for wrong numbers where the motion is poor.

The search for structural effects looks beside all parameters: what these absorb entirely, such as
friction under a load that hardly varies, is then told as wrong numbers.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.evidence import ParametricCause
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Indistinguishable
from idim_iv_ros.diagnosis.structural.candidate_rows import operating_range, rows_of, spread_shapes
from idim_iv_ros.effects.effect import Effect, OperatingRange
from idim_iv_ros.types import FloatArray


def confounders(
    data: Baseline, cause: ParametricCause, catalogue: Sequence[Effect]
) -> tuple[Indistinguishable, ...]:
    """Effects of the catalogue that make the torque of a wrong number, as well as it can be told.

    Those that no recording separates from it always count.

    `Indistinguishable.correlation` is the multiple correlation of the cause's torque with the
    effect's columns, in the best of a few shapes.
    """
    if cause.joint is None or cause.torque is None:
        return ()
    joint = data.joints.index(cause.joint)
    covered = operating_range(data)
    rivals = []
    for effect in catalogue:
        if effect.name in cause.effect.same_as:
            rivals.append(Indistinguishable(effect.name, cause.joint, 1.0))
        if effect.name not in cause.effect.confounders:
            continue
        correlation = _correlation(data, effect, joint, cause.torque, covered)
        if correlation >= settings.CONFOUNDER_CORRELATION:
            rivals.append(Indistinguishable(effect.name, cause.joint, correlation))
    return tuple(rivals)


def _correlation(
    data: Baseline, effect: Effect, joint: int, torque: FloatArray, covered: OperatingRange
) -> float:
    """Largest over the shapes, 0 to 1."""
    energy = float(torque @ torque)
    places = [place for place in effect.places(len(data.joints)) if place.joint == joint]
    if not places or energy <= 0.0:
        return 0.0
    shapes = spread_shapes(effect, places[0], covered)
    if not shapes:
        return 0.0
    largest = 0.0
    for shape, columns in zip(shapes, rows_of(data, effect, places[0], shapes), strict=True):
        coefficients = np.asarray(np.linalg.lstsq(columns[joint], torque, rcond=None)[0])
        if effect.admissible(shape, coefficients):
            rest = torque - columns[joint] @ coefficients
            largest = max(largest, 1.0 - float(rest @ rest) / energy)
    return float(np.sqrt(max(largest, 0.0)))
