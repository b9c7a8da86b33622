"""Numbers that the configuration itself leaves out: wrong before any recording is read.

They are in the model before other causes are looked for. Else these would take their place: the
inertia of six bare drives passes for a payload with moments of inertia.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.diagnosis.parametric.hypotheses import Hypothesis, changes_of, hypotheses
from idim_iv_ros.effects.parametric_effect import ParametricEffect


def left_out_numbers(
    changes: ChangeRegression, catalogue: Sequence[ParametricEffect]
) -> list[Hypothesis]:
    """Causes that the configuration names, where the recordings show any of them."""
    return [
        each
        for each in hypotheses(changes, catalogue)
        if each.effect.known_to_be_left_out(changes.space)
        and _support(changes, each) >= settings.LEAST_SUPPORT
    ]


def _support(changes: ChangeRegression, hypothesis: Hypothesis) -> float:
    alone = changes.explain(hypothesis.changes)
    return 0.5 * alone.statistic - 0.5 * alone.rank * float(np.log(changes.rows))


def without_negative_drives(
    changes: ChangeRegression, known: Sequence[Hypothesis], found: Sequence[Hypothesis]
) -> ChangeRegression:
    """Take the drives whose inertia would be negative out of those that were left out.

    Parameters
    ----------
    known
        See `left_out_numbers`.
    found
        The other causes.
    """
    estimates = changes.explain(changes_of([*known, *found])).found
    names = {
        each.change.name for each in estimates[: len(changes_of(known))] if each.clearly_negative
    }
    joints = changes.space.model.robot.joints
    negative = {joint for joint in changes.space.bare_drives if joints[joint] in names}
    space = replace(changes.space, bare_drives=changes.space.bare_drives - negative)
    return replace(changes, space=space)
