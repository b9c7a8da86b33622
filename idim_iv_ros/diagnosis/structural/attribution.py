"""Which effects explain what the refit leaves, found one after the other."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.identifiability.testability import cannot_show
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import (
    ERRORS_BEYOND_BASE,
    CommonShift,
    TiltedMoments,
)
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.candidate import Candidate, operating_range
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.diagnosis.structural.nonparametric import NONPARAMETRIC
from idim_iv_ros.diagnosis.structural.rules import (
    Judged,
    acceptable,
    own_cause,
    preferred,
    with_most_of_gap,
)
from idim_iv_ros.diagnosis.structural.search import Grids, Search
from idim_iv_ros.effects.effect import Effect, Place
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.progress import Progress


@dataclass(frozen=True)
class Found:
    """An accepted effect.

    Attributes
    ----------
    candidate : Candidate
    indistinguishable_from : tuple of (candidate, float)
        What predicts held-out data as well in its place, with the correlation of the torques; see
        `confidence`.
    alternatives : tuple of Candidate
        What was nearly as well supported when it was accepted.
    """

    candidate: Candidate
    indistinguishable_from: tuple[tuple[Judged, float], ...] = ()
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
    catalogue : tuple of Effect
        What was looked for.
    grids : dict
        Rows of the shapes that were tried, see `Search`; empty where nothing was found.
    """

    regression: Regression
    refit: Fit
    found: tuple[Found, ...]
    extended: Regression
    fit: Fit
    tried: int
    catalogue: tuple[Effect, ...] = ()
    grids: Grids = field(default_factory=dict)


def attributed(
    data: Baseline,
    regression: Regression,
    without: Collection[str],
    progress: Progress | None = None,
    grids: Grids | None = None,
    hidden: Collection[tuple[str, int]] = (),
) -> Attribution:
    """Look for effects of the catalogue beside the refit, and for nonparametric alternatives."""
    beyond = (*ERRORS_BEYOND_BASE, TiltedMoments(), CommonShift())
    structural = [*STRUCTURAL, *beyond]
    effects = [effect for effect in structural if effect.name not in without]
    return attribute(data, regression, [*effects, *NONPARAMETRIC], progress, grids, hidden)


def attribute(
    data: Baseline,
    regression: Regression,
    catalogue: Sequence[Effect],
    progress: Progress | None = None,
    grids: Grids | None = None,
    hidden: Collection[tuple[str, int]] = (),
) -> Attribution:
    """Accept the best effect beside those accepted before, until none is acceptable.

    Parameters
    ----------
    grids
        Rows of shapes of another search on the same motion.
    hidden
        Effects and joints where the recording cannot show them.
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
        candidates = _all(search, catalogue, found, known, hidden, progress)
        tried = tried or sum(each.tried for each in candidates)
        accepted = [each.candidate for each in found]
        candidates = [each for each in candidates if own_cause(each, accepted)]
        best = preferred(with_most_of_gap(candidates))
        again = None if best is None else search.again(best)
        if again is None or not acceptable(again[0]):
            break
        best, fit = again
        found.append(Found(best, alternatives=_alternatives(best, candidates)))
        current = current.with_columns(best.columns)
        if len(found) > 1:
            found, current, fit = _revised(search, regression, refit, found, catalogue, hidden)
        _forget(known, set(best.columns))
    # Most of the memory, and only folds that judge what was found need it.
    kept = grids if found else {}
    return Attribution(regression, refit, tuple(found), current, fit, tried, tuple(catalogue), kept)


def _alternatives(best: Candidate, candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Candidates that may predict as well as the best, each once, the best supported first."""
    least = settings.ALTERNATIVE_SUPPORT * best.support
    kept: dict[tuple[str, int, int | None], Candidate] = {}
    for each in candidates:
        if each.key != best.key and each.key not in kept and each.support >= least:
            kept[each.key] = each
    found = sorted(kept.values(), key=lambda each: -each.support)
    return tuple(found[: settings.MOST_ALTERNATIVES])


def _all(
    search: Search,
    catalogue: Sequence[Effect],
    found: Sequence[Found],
    known: dict[tuple[Effect, Place], Candidate | None],
    hidden: Collection[tuple[str, int]],
    progress: Progress | None,
) -> list[Candidate]:
    taken = {each.candidate.key for each in found}
    jobs: list[tuple[Effect, Place]] = [
        (effect, place)
        for effect in catalogue
        for place in effect.places(len(search.data.joints))
        if (effect.name, place.joint, place.other) not in taken
        and (effect.name, place.joint) not in hidden
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
    hidden: Collection[tuple[str, int]],
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
            if key not in taken and key[:2] not in hidden
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
