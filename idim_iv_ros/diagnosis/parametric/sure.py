"""Which parameter errors are there for sure, beside errors of all other given numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.diagnosis.parametric.confirmed import takes_nearly_all
from idim_iv_ros.diagnosis.parametric.hypotheses import Hypothesis, changes_of
from idim_iv_ros.diagnosis.parametric.other_errors import estimated_beside_other_errors
from idim_iv_ros.diagnosis.parametric.significance import differs
from idim_iv_ros.effects.parametric_effect import Estimated


@dataclass(frozen=True)
class SureOnlyTogether:
    """A hypothesis whose numbers differ from zero together, while each of them may be zero."""

    hypothesis: Hypothesis
    numbers: tuple[Estimated, ...]


@dataclass(frozen=True)
class Sure:
    """Hypotheses that are there for sure, their estimates, and those that are doubtful."""

    kept: tuple[Hypothesis, ...]
    numbers: tuple[tuple[Estimated, ...], ...]
    doubtful: tuple[SureOnlyTogether, ...]


def sure_of(changes: ChangeRegression, found: Sequence[Hypothesis]) -> Sure:
    """Hypotheses whose numbers differ from zero beside errors of all others, and estimates.

    They differ together, and one of those that make the effect what it is by itself: mass and
    moment of inertia of a payload move together with errors of its link, and their difference is
    sure where neither is. That the link's shape is off says the same, and is no payload.

    Others are dropped, the least sure first, and the rest is estimated again; but for one that
    alone takes nearly all that new parameters take of the gap, with at least one number whose
    interval leaves out zero. Errors of many other numbers would have to conspire to imitate it, and
    its intervals say what they leave open.
    """
    kept = list(found)
    doubtful: list[SureOnlyTogether] = []
    while kept:
        beside = estimated_beside_other_errors(changes, changes_of(kept))
        ends = np.cumsum([len(each.changes) for each in kept])
        parts = [slice(end - len(each.changes), end) for each, end in zip(kept, ends, strict=True)]
        numbers = [beside.found[part] for part in parts]
        p_values = [beside.p_value(part) for part in parts]
        unsure = [
            place
            for place, p_value in enumerate(p_values)
            if not _shown(kept[place], numbers[place])
            or (
                p_value > settings.PARAMETRIC_LEVEL
                and not takes_nearly_all(changes, kept[place].changes)
            )
        ]
        if not unsure:
            return Sure(tuple(kept), tuple(numbers), tuple(doubtful))
        least = max(unsure, key=lambda place: p_values[place])
        together = p_values[least] <= settings.PARAMETRIC_LEVEL
        if together and not any(differs(each.value, each.std) for each in numbers[least]):
            doubtful.append(SureOnlyTogether(kept[least], numbers[least]))
        del kept[least]
    return Sure((), (), tuple(doubtful))


def _shown(hypothesis: Hypothesis, own: Sequence[Estimated]) -> bool:
    """Whether a number that makes it the effect that it is leaves out zero by itself."""
    return any(differs(each.value, each.std) for each in hypothesis.effect.telling(own))
