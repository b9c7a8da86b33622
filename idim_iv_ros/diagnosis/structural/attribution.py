"""Which effects explain what the refit leaves, found one after the other."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.identifiability.testability import cannot_show
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import ERRORS_BEYOND_BASE
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.candidate import Candidate, operating_range
from idim_iv_ros.diagnosis.structural.confidence import confidence_set
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.structural.nonparametric import NONPARAMETRIC, Nonparametric
from idim_iv_ros.diagnosis.structural.scan import Scan
from idim_iv_ros.diagnosis.structural.search import Grids, Search
from idim_iv_ros.effects.effect import Effect, Place
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.progress import Progress
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class Found:
    """An accepted effect.

    Attributes
    ----------
    candidate : Candidate
    indistinguishable_from : tuple of (Candidate, float)
        What predicts held-out data as well in its place, with the correlation of the torques.
    alternatives : tuple of Candidate
        What was compared with it on held-out data.
    """

    candidate: Candidate
    indistinguishable_from: tuple[tuple[Candidate, float], ...] = ()
    alternatives: tuple[Candidate, ...] = ()


@dataclass(frozen=True)
class Attribution:
    """Outcome of the search.

    Attributes
    ----------
    regression : Regression
        Of the refit.
    refit : Fit
        Without effects.
    found : tuple of Found
        In the order in which they were accepted.
    extended : Regression
    fit : Fit
        With all accepted effects.
    tried : int
        Shapes that were tried at first, over all effects and places.
    """

    regression: Regression
    refit: Fit
    found: tuple[Found, ...]
    extended: Regression
    fit: Fit
    tried: int


def attributed(
    data: Baseline,
    regression: Regression,
    without: Collection[str],
    progress: Progress | None = None,
) -> Attribution:
    """Look for effects of the catalogue beside the refit, and for nonparametric alternatives."""
    structural = [*STRUCTURAL, *ERRORS_BEYOND_BASE]
    effects = [effect for effect in structural if effect.name not in without]
    return attribute(data, regression, [*effects, *NONPARAMETRIC], progress)


def attribute(
    data: Baseline,
    regression: Regression,
    catalogue: Sequence[Effect],
    progress: Progress | None = None,
    grids: Grids | None = None,
) -> Attribution:
    """Accept the best effect beside those accepted before, until none is acceptable.

    `grids`: rows of grids that another search of the same recordings made.
    """
    refit = regression.fit()
    covered = operating_range(data)
    found: list[Found] = []
    current, fit = regression, refit
    grids = {} if grids is None else grids
    tried = 0
    known: dict[tuple[Effect, Place], Candidate | None] = {}
    for _ in range(settings.MOST_EFFECTS + len(data.joints)):
        if len(found) >= settings.MOST_EFFECTS:
            break
        search = Search(data, covered, current, fit, grids)
        candidates = _all(search, catalogue, found, known, progress)
        tried = tried or sum(each.tried for each in candidates)
        candidates = [each for each in candidates if _own_cause(each, found)]
        best = preferred(with_most_of_gap(candidates))
        best = None if best is None else search.again(best)
        if best is None or not acceptable(best):
            break
        found.append(Found(best, alternatives=_alternatives(best, candidates)))
        current, fit = current.with_columns(best.columns), best.fit
        if len(found) > 1:
            found, current, fit = _revised(search, regression, refit, found, catalogue)
        _forget(known, set(best.columns))
    sets = _with_sets(data, regression, fit, found)
    return Attribution(regression, refit, sets, current, fit, tried)


def preferred(candidates: Sequence[Candidate]) -> Candidate | None:
    """Return the best effect of the catalogue, unless a nonparametric alternative is far better.

    The true shape is seldom that of the catalogue: a flexible function then fits a little better
    than the right effect. It fits much better than every wrong one.
    """
    named = [each for each in candidates if not isinstance(each.effect, Nonparametric)]
    flexible = [each for each in candidates if isinstance(each.effect, Nonparametric)]
    best = max(named, key=lambda each: each.support, default=None)
    alternative = max(flexible, key=lambda each: each.support, default=None)
    if best is None or alternative is None:
        return best or alternative
    least = settings.CATALOGUE_OVER_NONPARAMETRIC * alternative.support
    least -= settings.INDISTINGUISHABLE_SUPPORT
    return best if best.support >= least else alternative


def with_most_of_gap(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the acceptable candidates that explain most of the gap.

    The likelihood alone prefers what is fast and small, where there is little noise, to what is
    slow and large. That is found too, once the large is in the model.
    """
    able = [each for each in candidates if acceptable(each)]
    largest = max((each.explained for each in able), default=0.0)
    return [each for each in able if each.explained >= settings.LEAST_OF_LARGEST * largest]


def acceptable(candidate: Candidate) -> bool:
    """Whether a candidate is supported and large enough to matter."""
    rows = sum(len(candidate.fit.residuals[joint]) for joint in candidate.own_joints)
    share = 1.0 - np.exp(-2.0 * candidate.gain / rows)
    least = settings.LEAST_SUPPORT
    if candidate.effect.of_high_derivatives:
        least = settings.LEAST_SUPPORT_OF_DERIVATIVES
    return bool(
        candidate.support >= least
        and share >= settings.LEAST_SHARE_OF_EFFECT
        and candidate.explained >= settings.LEAST_SHARE_OF_EFFECT
    )


def _alternatives(best: Candidate, candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Candidates that may predict as well as the best, each once, the best supported first."""
    least = settings.ALTERNATIVE_SUPPORT * best.support
    kept: dict[tuple[str, int, int | None], Candidate] = {}
    for each in candidates:
        if each.key != best.key and each.key not in kept and each.support >= least:
            kept[each.key] = each
    found = sorted(kept.values(), key=lambda each: -each.support)
    return tuple(found[: settings.MOST_ALTERNATIVES])


def _with_sets(
    data: Baseline, regression: Regression, fit: Fit, found: Sequence[Found]
) -> tuple[Found, ...]:
    """Accepted effects, each with what is indistinguishable from it beside the others."""
    taken = {each.candidate.key for each in found}
    made = []
    for this in found:
        others = regression
        for other in found:
            if other is not this:
                others = others.with_columns(other.candidate.columns)
        free = [each for each in this.alternatives if each.key not in taken]
        kept = confidence_set(data, others, fit.noise_models, this.candidate, free)
        scan = Scan(others, fit.noise_models)
        pairs = tuple((each, _correlation(scan, this.candidate, each)) for each in kept)
        made.append(replace(this, indistinguishable_from=pairs))
    return tuple(made)


def _correlation(scan: Scan, first: Candidate, second: Candidate) -> float:
    """Of the torques that both add, whitened, less what the model absorbs."""
    one = scan.whiten(_torque(first))
    two = scan.whiten(_torque(second))
    energy = float(scan.normal(one, one)[0, 0] * scan.normal(two, two)[0, 0])
    if energy <= 0.0 or not set(one) & set(two):
        return 0.0
    return float(abs(scan.normal(one, two)[0, 0]) / np.sqrt(energy))


def _torque(candidate: Candidate) -> dict[int, FloatArray]:
    return {
        joint: (rows @ candidate.coefficients)[:, None] for joint, rows in candidate.columns.items()
    }


def _all(
    search: Search,
    catalogue: Sequence[Effect],
    found: Sequence[Found],
    known: dict[tuple[Effect, Place], Candidate | None],
    progress: Progress | None,
) -> list[Candidate]:
    taken = {each.candidate.key for each in found}
    jobs: list[tuple[Effect, Place]] = [
        (effect, place)
        for effect in catalogue
        for place in effect.places(len(search.data.joints))
        if (effect.name, place.joint, place.other) not in taken
        and not cannot_show(effect, place.joint, search.covered)
    ]
    for number, (effect, place) in enumerate(jobs):
        if (effect, place) in known:
            continue
        if progress is not None:
            joint = search.data.joints[place.joint]
            progress(f"trying {effect.name} at {joint}", number / len(jobs))
        known[(effect, place)] = search.best(effect, place)
    candidates = [known[job] for job in jobs]
    return [candidate for candidate in candidates if candidate is not None]


def _own_cause(candidate: Candidate, found: Sequence[Found]) -> bool:
    """Whether a nonparametric function is more than the misfit of an accepted effect.

    The shape of an effect is never exactly that of the catalogue: what a flexible function of the
    same family explains beside it, or a little beside it at the same joint, is no other cause.
    """
    if not isinstance(candidate.effect, Nonparametric):
        return True
    for other in (each.candidate for each in found):
        if isinstance(other.effect, Nonparametric) or not set(other.columns) & set(
            candidate.columns
        ):
            continue
        same = other.effect.family == candidate.effect.family
        least = settings.NONPARAMETRIC_BESIDE_EFFECT * other.support
        if same or candidate.support < least:
            return False
    return True


def _forget(known: dict[tuple[Effect, Place], Candidate | None], joints: set[int]) -> None:
    """Drop what was found at joints whose residual has changed since."""
    for effect, place in list(known):
        if place.joint in joints or place.other in joints:
            del known[(effect, place)]


def _revised(
    before: Search,
    regression: Regression,
    refit: Fit,
    found: list[Found],
    catalogue: Sequence[Effect],
) -> tuple[list[Found], Regression, Fit]:
    """Look at each effect again beside the others: its shape, alternatives, if it is needed."""
    data, covered, grids = before.data, before.covered, before.grids
    newest = found[-1]
    by_name = {effect.name: effect for effect in catalogue}
    kept = list(found)
    for this in found:
        if this is not newest and not set(this.candidate.columns) & set(newest.candidate.columns):
            continue
        others = regression
        for other in kept:
            if other is not this:
                others = others.with_columns(other.candidate.columns)
        fit = others.fit(refit.noise_models)
        search = Search(data, covered, others, fit, grids)
        options = {this.candidate.key: (this.candidate.effect, this.candidate.place)}
        joint = this.candidate.place.joint
        for name in by_name:
            for place in by_name[name].places(len(data.joints)):
                if name in this.candidate.effect.confounders and place.joint == joint:
                    options[(name, place.joint, place.other)] = (by_name[name], place)
        least = this.candidate.support - settings.INDISTINGUISHABLE_SUPPORT
        for close in this.alternatives:
            if close.support >= least:
                options[close.key] = (close.effect, close.place)
        taken = {other.candidate.key for other in kept if other is not this}
        again = [
            search.best(effect, place)
            for key, (effect, place) in options.items()
            if key not in taken
        ]
        usable = [candidate for candidate in again if candidate is not None]
        best = preferred(with_most_of_gap(usable))
        number = next(k for k, each in enumerate(kept) if each is this)
        if best is None or not acceptable(best):
            del kept[number]
        else:
            others_tried = [*usable, this.candidate, *this.alternatives]
            kept[number] = Found(best, alternatives=_alternatives(best, others_tried))
    current = regression
    for each in kept:
        current = current.with_columns(each.candidate.columns)
    return kept, current, current.fit(refit.noise_models)
