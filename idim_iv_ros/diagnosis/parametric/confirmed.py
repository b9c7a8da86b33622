"""Whether an error outside the base parameters is distinguished from errors of these.

A wrong torque gain of a joint changes its torque much as errors of the links beyond it, of its
friction and of its drive do together: with all inertials of a nominal model off by a little, the
gain that fits best is many deviations of the noise away from one. It is distinguished from them by
what no base parameters can do: the other joints feel the same links with a gain of one.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.diagnosis.parametric.significance import differs
from idim_iv_ros.effects.parametric_effect import Change, Estimated


def confirmed(changes: ChangeRegression, own: Sequence[Estimated]) -> bool:
    """Whether estimates hold where all base parameters are free beside them.

    They bring likelihood there beyond Schwarz's penalty, one of them differs from zero, and they
    keep most of their size and its sign.

    Parameters
    ----------
    changes
    own
        Estimates of changes outside the base parameters, beside the other causes.
    """
    free = changes.refit()
    beside = changes.explain([*changes.base_parameters, *(each.change for each in own)])
    found = beside.found[-len(own) :]
    numbers = beside.rank - free.rank
    support = 0.5 * (beside.statistic - free.statistic) - 0.5 * numbers * np.log(changes.rows)
    if support < settings.LEAST_SUPPORT or not any(differs(one.value, one.std) for one in found):
        return False
    before = np.array([each.value for each in own])
    after = np.array([each.value for each in found])
    return bool(before @ after >= settings.LEAST_CONFIRMED * (before @ before))


def takes_nearly_all(changes: ChangeRegression, named: Sequence[Change]) -> bool:
    """Whether changes alone take nearly all of the gap that new base parameters take."""
    alone = changes.share(changes.explain(named).contributions.sum(axis=1))
    return alone >= settings.ENOUGH_OF_CHANGE * changes.refit_share
