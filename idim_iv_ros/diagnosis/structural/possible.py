"""Which accepted effects have numbers that hardware may have.

The search fits any numbers that make a torque. Where no arm has them, the torque is there and the
name is wrong: the effect is a hint.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.gain_ripple import gain_is_as_likely, measured_as_current
from idim_iv_ros.diagnosis.structural.attribution import Found
from idim_iv_ros.diagnosis.structural.likelihood import Fit
from idim_iv_ros.effects.effect import OperatingRange
from idim_iv_ros.effects.position_ripple import PositionRipple
from idim_iv_ros.effects.waves import Waves
from idim_iv_ros.types import FloatArray, IntArray

_TINY = 1e-3  # of the largest torque beyond the knee: filters leave a trace on the rows around


def why_impossible(
    found: Found, coefficients: FloatArray, covered: OperatingRange, folds: Sequence[IntArray]
) -> str:
    """Why an effect cannot be what it is named; empty where it may be.

    Parameters
    ----------
    coefficients
        (w,) in the model that is judged.
    folds
        (r_j,) of each joint; −1 for rows that belong to none.
    """
    candidate = found.candidate
    joint = candidate.place.joint
    reason = candidate.effect.impossible(candidate.shape, coefficients, joint, covered)
    if reason or not candidate.effect.beyond_knee:
        return reason
    return why_not_reached(candidate.columns[joint][:, 0], folds[joint])


def why_of_the_gain(data: Baseline, found: Found, fit: Fit, coefficients: FloatArray) -> str:
    """Why a fast ripple of the torque may be one of a measured current's gain; empty if not.

    Parameters
    ----------
    fit
        Of the model with the effect.
    coefficients
        (w,) of the effect in it.
    """
    candidate = found.candidate
    shape, joint = candidate.shape, candidate.place.joint
    if candidate.effect.name != PositionRipple.name or not isinstance(shape, Waves):
        return ""
    slow = min(shape.wave_numbers) < settings.LEAST_WAVES
    if slow or not measured_as_current(data.prepared.configuration):
        return ""
    residuals = list(fit.residuals)
    residuals[joint] = residuals[joint] + candidate.columns[joint] @ coefficients
    without = replace(fit, residuals=tuple(residuals))
    if all(gain_is_as_likely(data, without, joint, each) for each in shape.wave_numbers):
        return (
            "the effort is a measured current, and a ripple of its gain, a property of the "
            "recording, explains as much"
        )
    return ""


def why_not_reached(torque: FloatArray, folds: IntArray) -> str:
    """Why the rows (r,) of a torque that acts beyond a knee do not show the knee, or empty."""
    beyond = np.abs(torque) > _TINY * float(np.max(np.abs(torque), initial=0.0))
    share = float(np.mean(beyond))
    if share > settings.MOST_BEYOND_KNEE:
        return (
            f"{100.0 * share:.0f} % of the motion is beyond the knee, which is then no limit of "
            "the torque"
        )
    reached = sum(
        float(np.mean(beyond[folds == fold])) >= settings.LEAST_BEYOND_KNEE
        for fold in np.unique(folds[folds >= 0])
    )
    if reached < 2:
        return f"the torque passes the knee in {reached} of {folds.max() + 1} folds"
    return ""
