"""What parameter errors make of the gap at each joint, and how much of it no cause accounts for."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.joint_units import unit_at
from idim_iv_ros.diagnosis.parametric.causes import ParametricOutcome
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import ParameterError


def parameter_errors(data: Baseline, outcome: ParametricOutcome) -> tuple[ParameterError, ...]:
    """Gap of the nominal model at each joint, with the causes and with all parameters refitted."""
    if outcome.given is None:
        return ()
    errors = []
    for joint, name in enumerate(data.joints):
        named, refit = float(outcome.after[joint]), float(outcome.refit[joint])
        remaining = float(np.sqrt(max(named**2 - refit**2, 0.0)))
        errors.append(
            ParameterError(
                joint=name,
                given=float(outcome.given[joint]),
                named=named,
                refit=refit,
                remaining=remaining,
                share_of_torque=remaining / float(outcome.sizes[joint]),
            )
        )
    return tuple(errors)


def remaining_words(data: Baseline, errors: Sequence[ParameterError]) -> str:
    """Say at which joints a parameter error remains that no cause names, the largest share first.

    Empty where none does.
    """
    said = []
    for joint, each in enumerate(errors):
        if (
            each.share_of_torque > settings.LEAST_PARAMETER_ERROR
            and each.named > settings.PARAMETER_ERROR_OVER_REFIT * each.refit
        ):
            unit = unit_at(data, joint, "N m")
            share = f"{100.0 * each.share_of_torque:.2g} % of its torque"
            words = f"{each.remaining:.3g} {unit} at {each.joint} ({share})"
            said.append((each.share_of_torque, words))
    if not said:
        return ""
    listed = ", ".join(words for _, words in sorted(said, reverse=True))
    return (
        f"Remaining parameter error: {listed}; refitted parameters remove it, but which of the "
        "given ones are in error cannot be determined."
    )
