"""What differs between recordings: terms of the search that act in some of them only.

A payload mounted for some recordings and not for others makes one mean payload with a small
interval: a wrong number that looks certain. So within one set numbers may differ in every
recording, beside the effects that all of them have.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue, Key, Kind, Scope
from idim_iv_ros.diagnosis.comparison.folds import chosen_without
from idim_iv_ros.diagnosis.comparison.ledger import Ledger, torque_ledger
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.select import Selection, select
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result.recordings import Difference, RecordingAgreement
from idim_iv_ros.effects.cause import Parameters
from idim_iv_ros.effects.parametric_effect import Change, Estimated, ParametricEffect
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.estimation.likelihood import rms
from idim_iv_ros.types import FloatArray, IntArray

_AGAIN = 2  # searches with effects of the recordings that differ


@dataclass(frozen=True, eq=False)
class Changes:
    """A search in which effects and numbers may act in some recordings only.

    Of their terms those that matter, and that the search chooses without parts of the time, too,
    are accepted; with the number of these parts, in words. Of free curves that is not asked.
    """

    selection: Selection
    accepted: dict[Term, str]
    doubtful: dict[Term, str]

    @property
    def common(self) -> tuple[Term, ...]:
        """Terms of all recordings."""
        return tuple(term for term in self.selection.model.terms if not term.candidate.scope)


def changes_between(catalogue: Catalogue, taken_out: Sequence[Term] = ()) -> Changes:
    """Search with free numbers for all recordings, so that errors of the nominal model cancel.

    `catalogue`: with candidates that act in some recordings only; `taken_out`: terms of another
    search whose torque is taken out first.
    """
    data = catalogue.data
    ledger = torque_ledger(data, free=True)
    gap = list(ledger.gap)
    for term in taken_out:
        gap = term.taken_from(gap)
    selection = select(catalogue, replace(ledger, gap=tuple(gap)))
    accepted: dict[Term, str] = {}
    doubtful: dict[Term, str] = {}
    if any(term.candidate.scope for term in selection.terms):
        chosen = chosen_without(selection, quarters(data, ledger))
        for term, gains in zip(selection.terms, chosen.gains.T, strict=True):
            if not term.candidate.scope:
                continue
            times = chosen.times(term)
            often = times >= len(chosen.keys) - 1 and float(gains.sum()) > 0.0
            matters = often and float(term.whole.max()) >= settings.LEAST_SHARE
            (accepted if matters else doubtful)[term] = f"{times} of {len(chosen.keys)}"
    for curve in selection.curves:
        if curve.candidate.scope:
            (accepted if curve.presence >= settings.PRESENCE else doubtful)[curve] = ""
    return Changes(selection, accepted, doubtful)


def quarters(data: Baseline, ledger: Ledger) -> IntArray:
    """Part (blocks,) of each block of time: one quarter of every recording, in its order.

    Without a whole recording its set is another one, and a change of the set and one of the
    recordings that are left are the same.
    """
    recording = np.zeros(ledger.block_count, dtype=np.int64)
    for blocks, recordings in zip(ledger.blocks, data.recordings, strict=True):
        recording[blocks] = recordings
    blocks_of = np.bincount(recording)[recording]
    place = np.arange(len(recording)) - np.searchsorted(recording, recording)
    folds = int(settings.FOLDS)
    turn = np.where(blocks_of < folds, recording, 0)  # short ones take turns
    return np.asarray((place * folds // np.maximum(blocks_of, folds) + turn) % folds)


def rms_of(data: Baseline, terms: Sequence[Term], recordings: Scope) -> FloatArray:
    """RMS (n_joints,) of the torque of terms in some recordings, N m (N)."""
    made = np.zeros(len(data.joints))
    for joint, numbers in enumerate(data.recordings):
        inside = np.isin(numbers, list(recordings))
        parts = [t.columns[joint][inside] @ t.coefficients for t in terms if joint in t.columns]
        if parts:
            made[joint] = rms(np.sum(parts, axis=0))
    return made


@dataclass(frozen=True, eq=False)
class NumberChange:
    """Numbers that differ in some recordings from all others."""

    effect: ParametricEffect
    joint: int | None
    recordings: Scope
    parameters: Parameters  # the difference, with its deviations
    terms: tuple[Term, ...]


def number_changes(changes: Changes) -> list[NumberChange]:
    """Changes of numbers, recordings with the same terms together.

    A change of all recordings of a set and one of a single recording of it add up there.
    """
    model = changes.selection.model
    places: dict[tuple[str, int | None], list[tuple[Term, int]]] = {}
    for term, block in zip(model.terms, model.blocks, strict=True):
        if term.candidate.kind is Kind.NUMBER and term in changes.accepted:
            places.setdefault(term.key[:2], []).append((term, block.start))
    made = []
    for (_, joint), parts in places.items():
        groups: dict[tuple[int, ...], list[int]] = {}
        scopes = [term.candidate.scope for term, _ in parts]
        for recording in sorted(frozenset().union(*scopes)):
            there = tuple(k for k, scope in enumerate(scopes) if recording in scope)
            groups.setdefault(there, []).append(recording)
        effect = parts[0][0].candidate.effect
        assert isinstance(effect, ParametricEffect)
        for there, group in groups.items():
            terms = tuple(parts[k][0] for k in there)
            same: dict[str, tuple[Change, list[int]]] = {}  # and the places of its coefficients
            for term, start in (parts[k] for k in there):
                for place, change in enumerate(term.candidate.changes, start):
                    same.setdefault(change.name, (change, []))[1].append(place)
            spread = max(1.0, *(term.dispersion for term in terms))
            estimates = []
            for change, which in same.values():
                variance = spread * float(model.covariance[np.ix_(which, which)].sum())
                value, std = float(model.coefficients[which].sum()), np.sqrt(max(variance, 0.0))
                estimates.append(Estimated(change, value, float(std)))
            numbers = effect.parameters(estimates)
            made.append(NumberChange(effect, joint, frozenset(group), numbers, terms))
    return made


Differing = list[tuple[int, FloatArray, Difference]]
"""What recordings have otherwise than the others: number of one, shares (n_joints,), and what."""


def numbers_apart(catalogue: Catalogue, taken_out: Sequence[Term] = ()) -> Differing:
    """Let numbers differ between the recordings of a session: in one, or from one on.

    Of two recordings that differ the second is named: nothing says which of them is right.

    `catalogue`: of the session; `taken_out`: structural causes, whose torque is taken out first.
    """
    if len(catalogue.data.motions) < 2:
        return []
    return _differences(catalogue.differing((), _scopes(catalogue)), taken_out)


def with_effects(catalogue: Catalogue, apart: Differing, common: Collection[Key]) -> Differing:
    """Let effects of the recordings that differ, and `common` ones, compete with numbers.

    Where none of either is chosen, what numbers said by themselves stands.
    """
    count, by_themselves, before = len(catalogue.data.motions), apart, frozenset[int]()
    for _ in range(_AGAIN):
        scope = frozenset(number for number, *_ in apart)
        if scope in (before, frozenset()):
            break
        before = scope
        whole = scope if len(scope) < count else frozenset(range(1, count))
        apart = _differences(catalogue.differing([whole], _scopes(catalogue), common))
    effects = [what for _, _, what in apart if BY_NAME[what.effect].kind == "structural"]
    return apart if effects or common else by_themselves


def agreement(data: Baseline, apart: Differing) -> tuple[RecordingAgreement, ...]:
    """One entry for each of several recordings, empty of one."""
    if len(data.motions) < 2:
        return ()
    made = []
    for place, part in enumerate(data.prepared.session.parts):
        some = [(shares, what) for number, shares, what in apart if number == place]
        some.sort(key=lambda pair: -float(pair[0].max()))
        squares = sum((shares**2 for shares, _ in some), np.zeros(len(data.joints)))
        worst, listed = int(np.argmax(squares)), tuple(difference for _, difference in some)
        share = float(np.sqrt(squares[worst]))
        made.append(RecordingAgreement(part.bag, not some, data.joints[worst], share, listed))
    return tuple(made)


def _scopes(catalogue: Catalogue) -> list[Scope]:
    """Recordings in which a number may differ: any single one, and all from one on."""
    count = len(catalogue.data.motions)
    scopes = [frozenset({number}) for number in range(1 if count == 2 else 0, count)]
    return scopes + [frozenset(range(first, count)) for first in range(2, count - 1)]


def _differences(catalogue: Catalogue, taken_out: Sequence[Term] = ()) -> Differing:
    data, changes, made = catalogue.data, changes_between(catalogue, taken_out), []
    named = [
        (change.effect.name, change.joint, change.parameters, change.terms, change.recordings)
        for change in number_changes(changes)
    ]
    effects = [term for term in changes.accepted if term.is_effect]
    named += [(*t.key[:2], t.parameters, (t,), t.key.scope) for t in effects]
    for effect, joint, numbers, terms, recordings in named:
        shares = rms_of(data, terms, recordings) / data.torque_sizes
        place = None if joint is None else data.joints[joint]
        made += [(n, shares, Difference(effect, place, numbers)) for n in sorted(recordings)]
    return made
