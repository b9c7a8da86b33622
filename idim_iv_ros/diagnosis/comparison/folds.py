"""What is chosen without a part of the time, and how well it predicts that part."""

from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.candidate import Key, Kind
from idim_iv_ros.diagnosis.comparison.compare import Comparison
from idim_iv_ros.diagnosis.comparison.model_with_terms import NominalErrors, Term
from idim_iv_ros.diagnosis.comparison.options import without_parts
from idim_iv_ros.diagnosis.comparison.select import Selection, climb
from idim_iv_ros.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Chosen:
    """What the search does without each of some parts of the time.

    `keys`: effects and places that are chosen without each; `gains` (folds, terms): logarithm of
    the predictive density of the part that each term of the selection brings.
    """

    keys: tuple[frozenset[Key], ...]
    gains: FloatArray

    def times(self, term: Term) -> int:
        """In how many folds a term, or a rival of its set, is chosen.

        Of an effect of some recordings it is enough to be chosen for one of them; of a number, to
        be chosen for any: less of it in one recording is more of it in all others.
        """
        names = {key[:3] for key, _ in term.rivals} | {term.key[:3]}
        scope, is_number = term.candidate.scope, term.candidate.kind is Kind.NUMBER

        def is_in(keys: frozenset[Key]) -> bool:
            there = [key for key in keys if key[:3] in names]
            return any(not scope or scope & key.scope or (is_number and key.scope) for key in there)

        return sum(map(is_in, self.keys))


def chosen_without(selection: Selection, part: IntArray | None = None) -> Chosen:
    """Search again without each of some parts of the time.

    `part`: (blocks,) that each block of time belongs to; None: equal stretches of the session.
    """
    comparison = selection.comparison
    nominal, ledger = comparison.nominal, comparison.options.ledger
    if part is None:
        count, folds = ledger.block_count, int(settings.FOLDS)
        part = np.arange(count) * folds // max(count, folds)
    keys, gains, terms = [], [], selection.terms
    without = [(*terms[:k], *terms[k + 1 :]) for k in range(len(terms))]
    parts = [part[block] for block in ledger.blocks]
    for fold, white in enumerate(without_parts(nominal.white, parts)):
        counted: list[BoolArray] = [number != fold for number in parts]
        fitted = Comparison(comparison.catalogue, NominalErrors(white, nominal.errors))
        keys.append(frozenset(term.key for term in climb(fitted, ())))
        whole, *losses = (_loss(fitted, some, selection, counted) for some in (terms, *without))
        gains.append([loss - whole for loss in losses])
        del fitted  # before the next one is made
    return Chosen(tuple(keys), np.array(gains).reshape(len(keys), len(terms)))


def _loss(
    fitted: Comparison, terms: tuple[Term, ...], selection: Selection, counted: list[BoolArray]
) -> float:
    """Half the energy of the whitened rows that are not counted, predicted from the others."""
    energy, noise = 0.0, selection.comparison.nominal.white.noise
    residuals = fitted.with_terms(terms).residuals
    for joint, rows in enumerate(fitted.options.ledger.joints):
        if not rows.left_out:
            rest = noise[joint].standardized(residuals[joint], rows.segments)
            energy += 0.5 * float(np.sum(rest[~counted[joint]] ** 2))
    return energy
