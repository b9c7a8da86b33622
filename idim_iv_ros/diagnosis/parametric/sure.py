"""Which parameter errors are there for sure, beside errors of all other given numbers."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import ChangeRegression
from idim_iv_ros.diagnosis.parametric.confirmed import takes_nearly_all
from idim_iv_ros.diagnosis.parametric.hypotheses import Hypothesis, changes_of
from idim_iv_ros.diagnosis.parametric.other_errors import estimated_beside_other_errors
from idim_iv_ros.diagnosis.parametric.significance import differs
from idim_iv_ros.effects.link_inertia import LinkInertia
from idim_iv_ros.effects.parametric_effect import Estimated
from idim_iv_ros.effects.payload import Payload


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


def sure_of(
    changes: ChangeRegression, found: Sequence[Hypothesis], *, with_own_links: bool = False
) -> Sure:
    """Hypotheses whose numbers differ from zero beside errors of all others, and estimates.

    They differ together, and one of those that make the effect what it is by itself: mass and
    moment of inertia of a payload move together with errors of its link, and their difference is
    sure where neither is. That the link's shape is off says the same, and is no payload.

    Others are dropped, the least sure first, and the rest is estimated again; but for one that
    alone takes nearly all that new parameters take of the gap, with at least one number whose
    interval leaves out zero. Errors of many other numbers would have to conspire to imitate it, and
    its intervals say what they leave open.

    Parameters
    ----------
    changes
    found
    with_own_links
        Whether a body that is not sure beside errors of its own link may be so beside errors of
        all other numbers; see `_beside_its_link`. Of each body what is sure then takes most.
    """
    kept = list(found)
    doubtful: list[SureOnlyTogether] = []
    known: set[int | None] = set()  # joints whose links have no errors but those that a body holds
    while kept:
        beside = estimated_beside_other_errors(changes, changes_of(kept), known)
        ends = np.cumsum([len(each.changes) for each in kept])
        parts = [slice(end - len(each.changes), end) for each, end in zip(kept, ends, strict=True)]
        numbers = [beside.found[part] for part in parts]
        p_values = [beside.p_value(part) for part in parts]
        unsure = [
            place
            for place, p_value in enumerate(p_values)
            if not _shown(kept[place], numbers[place])
            or (
                _is_body(kept[place])
                and with_own_links
                and not _mostly_sure(changes, numbers[place])
            )
            or (
                p_value > settings.PARAMETRIC_LEVEL
                and not takes_nearly_all(changes, kept[place].changes)
            )
        ]
        if not unsure:
            sure = Sure(tuple(kept), tuple(numbers), tuple(doubtful))
            return _named_by_size(changes, sure, known)
        least = max(unsure, key=lambda place: p_values[place])
        body = _beside_its_link(changes, kept, least) if with_own_links else None
        if body is not None and body.joint not in known:
            known.add(body.joint)
            kept[least] = body
            continue
        together = p_values[least] <= settings.PARAMETRIC_LEVEL
        if together and not any(differs(each.value, each.std) for each in numbers[least]):
            doubtful.append(SureOnlyTogether(kept[least], numbers[least]))
        known &= {each.joint for each in kept if each is not kept[least] and _is_body(each)}
        del kept[least]
    return Sure((), (), tuple(doubtful))


def _shown(hypothesis: Hypothesis, own: Sequence[Estimated]) -> bool:
    """Whether a number that makes it the effect that it is leaves out zero by itself."""
    return any(differs(each.value, each.std) for each in hypothesis.effect.telling(own))


def _is_body(hypothesis: Hypothesis) -> bool:
    return hypothesis.effect.name in (Payload.name, LinkInertia.name)


def _beside_its_link(
    changes: ChangeRegression, kept: Sequence[Hypothesis], place: int
) -> Hypothesis | None:
    """The whole of a body that takes nearly all, or nearly all that the others leave; else None.

    A payload that is small beside its link may be an error of the link as large as nominal models
    have them, and the other way round: one or the other, with the same torque. That one of them is
    there is a question of errors of the other numbers alone, and the answer names both.
    """
    this = kept[place]
    if not _is_body(this):
        return None
    without, together = (
        changes.share(changes.explain(changes_of(some)).contributions.sum(axis=1))
        for some in ([each for each in kept if each is not this], kept)
    )
    beside = together - without >= settings.ENOUGH_OF_CHANGE * (changes.refit_share - without)
    if not (beside or takes_nearly_all(changes, this.changes)):
        return None
    whole = this.effect.variants(changes.space, this.joint)[-1]
    return replace(this, changes=tuple(whole))


def _named_by_size(changes: ChangeRegression, sure: Sure, known: Collection[int | None]) -> Sure:
    """Call a body a payload or an error of its link, for joints whose body may be either.

    It is a payload, with these estimates, where it is sure beside an error of its link that is as
    large as errors of all other numbers; else its numbers are a change of the link's.
    """
    if not known:
        return sure
    beside = estimated_beside_other_errors(changes, changes_of(sure.kept), one_size=True)
    kept, numbers, end = list(sure.kept), list(sure.numbers), 0
    for place, each in enumerate(sure.kept):
        part = slice(end, end := end + len(each.changes))
        if each.joint not in known or each.effect.name != Payload.name:
            continue
        own = beside.found[part]
        if _shown(each, own) and beside.p_value(part) <= settings.SIGNIFICANCE_LEVEL:
            numbers[place] = own
            continue
        # The same directions in the same order, by other names.
        changed = tuple(LinkInertia().variants(changes.space, each.joint)[0])
        kept[place] = Hypothesis(LinkInertia(), each.joint, changed)
        numbers[place] = tuple(
            replace(number, change=change)
            for number, change in zip(numbers[place], changed, strict=True)
        )
    return replace(sure, kept=tuple(kept), numbers=tuple(numbers))


def _mostly_sure(changes: ChangeRegression, own: Sequence[Estimated]) -> bool:
    """Whether those numbers that leave out zero take most of the gap that all of them take.

    An error of the link before, or of its torque's gain, passes for a mass on the next one: the
    mass is not sure then, and what is sure beside it are small errors of this link.
    """
    sure = [each.change for each in own if differs(each.value, each.std)]
    taken, whole = (
        changes.share(changes.explain(each).contributions.sum(axis=1))
        for each in (sure, [each.change for each in own])
    )
    return taken >= settings.LEAST_SURE_SHARE * whole
