"""What differs between recordings: terms of the search that act in some of them only.

A payload mounted for some recordings and not for others makes one mean payload with a small
interval: a wrong number that looks sure. So within one set numbers may differ in every recording,
beside the effects that all of them have.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis.comparison import rules
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue, Key, Kind, Scope
from idim_iv_ros.diagnosis.comparison.folds import FOLDS, chosen_without
from idim_iv_ros.diagnosis.comparison.ledger import Ledger, torque_ledger
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.diagnosis.comparison.select import Selection, select
from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import Difference, EffectParameter, RecordingAgreement
from idim_iv_ros.effects.parametric_effect import Estimated, ParametricEffect
from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Changes:
    """A search in which effects and numbers may act in some recordings only.

    Attributes
    ----------
    selection : Selection
    confirmed : tuple of Term
        Scoped ones that matter, and that the search chooses without parts of the time, too.
    chosen : dict of int to str
        By the identity of a scoped term: without how many parts of the time it is chosen.
    """

    selection: Selection
    confirmed: tuple[Term, ...]
    chosen: dict[int, str]

    @property
    def common(self) -> tuple[Term, ...]:
        """Terms of all recordings."""
        selection = self.selection
        return tuple(
            term for term in (*selection.terms, *selection.curves) if term.candidate.scope is None
        )


def changes_between(
    data: Baseline,
    regression: Regression,
    scopes: Sequence[Scope],
    number_scopes: Sequence[Scope],
    without: Collection[str] = (),
    beside: Sequence[Term] = (),
) -> Changes:
    """Search with free numbers for all recordings, so that errors of the nominal model cancel.

    Parameters
    ----------
    scopes, number_scopes
        Recordings in which effects, and numbers, may differ from all others.
    without
        Effects that are left out of the catalogue.
    beside
        Terms of another search whose torque is taken out first.
    """
    catalogue = Catalogue(data, regression, without, scopes=scopes, number_scopes=number_scopes)
    ledger = torque_ledger(data, regression, free=True)
    gap = list(ledger.gap)
    for term in beside:
        for joint, rows in term.columns.items():
            gap[joint] = gap[joint] - rows @ term.coefficients
    selection = select(catalogue, replace(ledger, gap=tuple(gap)))
    confirmed, said = [], {}
    if any(term.candidate.scope is not None for term in selection.terms):
        chosen = chosen_without(selection, quarters(data, ledger))
        for number, term in enumerate(selection.terms):
            if term.candidate.scope is None:
                continue
            times = sum(_has(keys, term) for keys in chosen.keys)
            said[id(term)] = f"{times} of {len(chosen.keys)}"
            matters = float(term.whole.max()) >= rules.LEAST_SHARE
            predicts = float(chosen.gains[:, number].sum()) > 0.0
            if matters and predicts and times >= len(chosen.keys) - 1:
                confirmed.append(term)
    curves = [term for term in selection.curves if term.candidate.scope is not None]
    confirmed += [term for term in curves if term.presence >= rules.PRESENCE]
    return Changes(selection, tuple(confirmed), said)


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
    turn = np.where(blocks_of < FOLDS, recording, 0)  # short ones take turns
    return np.asarray((place * FOLDS // np.maximum(blocks_of, FOLDS) + turn) % FOLDS)


def _has(keys: Collection[Key], term: Term) -> bool:
    """Whether a set has a term or a rival of it, for some of its recordings at least."""
    names = {key[:3] for key, _ in term.rivals} | {term.key[:3]}
    own = term.candidate.scope or frozenset()
    return any(key[:3] in names and own & (key[3] or frozenset()) for key in keys)


def rms_of(data: Baseline, terms: Sequence[Term], recordings: Scope) -> FloatArray:
    """RMS (n_joints,) of the torque of terms in some recordings, N m (N)."""
    made = np.zeros(len(data.joints))
    for joint, numbers in enumerate(data.recordings):
        inside = np.isin(numbers, list(recordings))
        torque = np.zeros(int(inside.sum()))
        for term in terms:
            if joint in term.columns:
                torque += term.columns[joint][inside] @ term.coefficients
        made[joint] = np.sqrt(np.mean(torque**2)) if len(torque) else 0.0
    return made


@dataclass(frozen=True, eq=False)
class NumberChange:
    """Numbers that differ in some recordings from all others.

    Attributes
    ----------
    effect : ParametricEffect
    joint : int or None
    recordings : Scope
    estimates : tuple of Estimated
    terms : tuple of Term
    """

    effect: ParametricEffect
    joint: int | None
    recordings: Scope
    estimates: tuple[Estimated, ...]
    terms: tuple[Term, ...]

    def parameters(self, changes: Changes) -> dict[str, EffectParameter]:
        """Numbers with their deviations."""
        space = changes.selection.comparison.catalogue.space
        return self.effect.parameters(space, self.joint, list(self.estimates))


def number_changes(changes: Changes) -> list[NumberChange]:
    """Changes of numbers, recordings with the same terms together.

    A change of all recordings of a set and one of a single recording of it add up there.
    """
    model = changes.selection.model
    places: dict[tuple[str, int | None], list[tuple[Term, int]]] = {}
    terms = (*changes.selection.terms, *changes.selection.curves)
    for term, start in zip(terms, model.starts, strict=False):
        if term.candidate.kind is Kind.NUMBER and any(
            term is change for change in changes.confirmed
        ):
            places.setdefault(term.key[:2], []).append((term, start))
    made = []
    for (_, joint), parts in places.items():
        recordings = sorted(frozenset().union(*(term.candidate.scope or () for term, _ in parts)))
        groups: dict[tuple[int, ...], list[int]] = {}
        for recording in recordings:
            there = tuple(
                k for k, (term, _) in enumerate(parts) if recording in (term.candidate.scope or ())
            )
            groups.setdefault(there, []).append(recording)
        for there, group in groups.items():
            some = [parts[k] for k in there]
            effect = some[0][0].candidate.effect
            assert isinstance(effect, ParametricEffect)
            made.append(
                NumberChange(
                    effect,
                    joint,
                    frozenset(group),
                    _summed(some, model.coefficients, model.covariance),
                    tuple(term for term, _ in some),
                )
            )
    return made


def _summed(
    parts: Sequence[tuple[Term, int]], coefficients: FloatArray, covariance: FloatArray
) -> tuple[Estimated, ...]:
    """Add the changes of one name, with the deviations of their sums."""
    places: dict[str, list[int]] = {}
    named = {}
    spread = 1.0
    for term, start in parts:
        spread = max(spread, term.dispersion)
        for k, change in enumerate(term.candidate.changes):
            places.setdefault(change.name, []).append(start + k)
            named[change.name] = change
    made = []
    for name, which in places.items():
        variance = spread * float(covariance[np.ix_(which, which)].sum())
        value = float(coefficients[which].sum())
        made.append(Estimated(named[name], value, float(np.sqrt(max(variance, 0.0)))))
    return tuple(made)


def agreement(
    data: Baseline,
    regression: Regression,
    beside: Sequence[Term] = (),
    without: Collection[str] = (),
) -> tuple[RecordingAgreement, ...]:
    """Let numbers differ in every recording; one entry for each of several, empty of one.

    Of two recordings that differ the second is named: nothing says which of them is right.

    Parameters
    ----------
    regression
        Of the refit.
    beside
        Structural causes, whose torque is taken out first.
    without
        Effects that are left out of the catalogue.
    """
    count = len(data.motions)
    if count < 2:
        return ()
    first = 1 if count == 2 else 0
    scopes = [frozenset({number}) for number in range(first, count)]
    structural = {effect.name for effect in STRUCTURAL}
    changes = changes_between(data, regression, (), scopes, {*without, *structural}, beside)
    differences: dict[int, list[tuple[FloatArray, Difference]]] = {}
    for number_change in number_changes(changes):
        shares = rms_of(data, number_change.terms, number_change.recordings) / np.array(
            data.torque_sizes
        )
        joint = None if number_change.joint is None else data.joints[number_change.joint]
        difference = Difference(number_change.effect.name, joint, number_change.parameters(changes))
        for number in number_change.recordings:
            differences.setdefault(number, []).append((shares, difference))
    return tuple(
        _entry(data, part.bag, differences.get(number, ()))
        for number, part in enumerate(data.prepared.session.parts)
    )


def _entry(
    data: Baseline, bag: str, differences: Sequence[tuple[FloatArray, Difference]]
) -> RecordingAgreement:
    """One recording with its differences and their shares of the torque (n_joints,)."""
    ordered = sorted(differences, key=lambda each: -float(each[0].max()))
    squares = sum((shares**2 for shares, _ in ordered), np.zeros(len(data.joints)))
    joint = int(np.argmax(squares))
    return RecordingAgreement(
        bag=bag,
        agrees=not ordered,
        joint=data.joints[joint],
        share_of_torque=float(np.sqrt(squares[joint])),
        differences=tuple(difference for _, difference in ordered),
    )
