"""What each accepted effect cannot be distinguished from: a model confidence set for its place.

Everything that would be accepted in its place, at any joint, of the catalogue, beyond it or an
error of the parameters, takes its place beside the other effects. All coefficients are fitted again
without a block of time, which is then predicted; the score is the logarithm of the predictive
density, with the variance that each model leaves. Those that predict no worse than the best are
indistinguishable.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.attribution import Found
from idim_iv_ros.diagnosis.structural.fold_model import FoldModel
from idim_iv_ros.diagnosis.structural.fold_products import EVERY_FOLD, FoldProducts
from idim_iv_ros.diagnosis.structural.fold_search import FoldCandidate, FoldSearch
from idim_iv_ros.diagnosis.structural.likelihood import Columns
from idim_iv_ros.diagnosis.structural.menu import Menu
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric
from idim_iv_ros.effects.time_delay import TimeDelay
from idim_iv_ros.statistics.model_confidence_set import model_confidence_set
from idim_iv_ros.types import FloatArray, IntArray

_SEED = 20110


def with_sets(data: Baseline, search: FoldSearch, found: Sequence[Found]) -> tuple[Found, ...]:
    """Accepted effects, each with what is indistinguishable from it beside the others.

    Parameters
    ----------
    search
        With the noise models of the fit with all of `found`.
    """
    white = search.white
    products = FoldProducts(
        white.regression, white.noise_models, white.values, blocks_of(data), Menu(())
    )
    made = []
    for this in found:
        others = [each.candidate for each in found if each is not this]
        alternatives = alternatives_to(search, this, found)
        if not alternatives:
            made.append(replace(this, indistinguishable_from=()))
            continue
        losses = held_out_losses(
            products,
            [each.columns for each in others],
            [this.candidate.columns, *(each.columns for each in alternatives)],
        )
        kept = included(losses)
        beside = [other.columns for other in others]
        pairs = [
            (each, correlation(white, beside, this, each))
            for number, each in enumerate(alternatives, 1)
            if number in kept
        ]
        # What shares no torque with it does not take its place: it would be one cause more.
        close = [pair for pair in pairs if pair[1] >= settings.ALTERNATIVE_CORRELATION]
        made.append(replace(this, indistinguishable_from=tuple(close)))
    return tuple(made)


def included(losses: FloatArray) -> set[int]:
    """Models (b, m) of the set, and those whose score over all blocks is as good as the best's.

    Where two torques are almost the same, a difference of nothing is sure: it decides nothing.
    """
    total = losses.sum(axis=0)
    close = np.flatnonzero(total <= total.min() + settings.INDISTINGUISHABLE_SUPPORT)
    sure = model_confidence_set(losses, settings.CONFIDENCE_SET_SIZE, seed=_SEED).included
    return {*sure, *(int(each) for each in close)}


def alternatives_to(search: FoldSearch, this: Found, found: Sequence[Found]) -> list[FoldCandidate]:
    """What would be accepted in the place of an effect, the best supported first.

    Of nonparametric functions those of other families: one of its own describes the same torque.
    Except where a delay is taken for the effect: the free dynamics of the torque hold delays and
    lags of a drive, beside what the common shift of the recording has taken out.
    """
    model = search.model(EVERY_FOLD)
    taken = {each.candidate.key for each in found}
    for each in found:
        if each is not this:
            model = model.beside(each.candidate)
    able = [
        each
        for each in search.candidates(model, taken, refined=int(settings.REFINED_ALTERNATIVES))
        if each.gain >= settings.ALTERNATIVE_GAIN * this.candidate.gain
        and not _same_torque(this, each)
    ]
    able.sort(key=lambda each: -each.support)
    return able[: settings.MOST_ALTERNATIVES]


def _same_torque(this: Found, other: FoldCandidate) -> bool:
    """Whether a nonparametric function only describes the torque of an effect."""
    effect = this.candidate.effect
    if not isinstance(other.effect, Nonparametric) or other.effect.family != effect.family:
        return False
    return TimeDelay.name not in effect.confounders or effect.family != TimeDelay.family


def blocks_of(data: Baseline) -> list[IntArray]:
    """Block of every row of every joint: equal stretches of each recording."""
    lengths = np.array([len(motion.kept) for motion in data.motions])
    seconds = float(lengths.sum()) / data.row_rate
    wanted = max(seconds / settings.CONFIDENCE_LEAST_BLOCK, settings.CONFIDENCE_FEWEST_BLOCKS)
    wanted = min(wanted, settings.CONFIDENCE_MOST_BLOCKS)
    counts = np.maximum(np.round(wanted * lengths / lengths.sum()), 1).astype(np.int64)
    first = np.concatenate([[0], np.cumsum(counts)])
    return [
        first[recording] + place * counts[recording] // lengths[recording]
        for recording, place in zip(data.recordings, data.places, strict=True)
    ]


def held_out_losses(
    products: FoldProducts, others: Sequence[Columns], models: Sequence[Columns]
) -> FloatArray:
    """Negative log predictive density of each block, predicted from the others: (b, m).

    Parameters
    ----------
    products
        Of the refit, with one fold for each block.
    others
        Columns that every model has.
    models
        Columns that take turns.
    """
    losses = np.zeros((products.count, len(models)))
    blocks = [products.block(("model", k), columns) for k, columns in enumerate(others)]
    turns = [products.block(("turn", id(columns)), columns) for columns in models]
    for fold in range(products.count):
        model = FoldModel(products, fold)
        for key, block in enumerate(blocks):
            model = model.beside(("model", key), block)
        views = [model.view(block) for block in turns]
        coefficients, energies = model.with_candidates(views)
        variances = energies / (products.rows @ model.weights)
        changes = model.changes(views, coefficients)
        for joint, theta in enumerate(model.theta):
            inside = products.folds[joint] == fold
            rest = products.rest(joint, inside, blocks, theta[:, None] + changes[joint])
            for k, (block, own) in enumerate(zip(turns, coefficients, strict=True)):
                if joint in block.white:
                    rest[:, k] -= block.white[joint][inside] @ own
            variance = variances[:, joint]
            count = int(inside.sum())
            losses[fold] += 0.5 * (count * np.log(variance) + np.sum(rest**2, axis=0) / variance)
    return losses


def correlation(
    products: FoldProducts, others: Sequence[Columns], this: Found, other: FoldCandidate
) -> float:
    """Of the torques that both add, whitened, less what the model absorbs, 0 to 1."""
    model = FoldModel(products.without_menu(), EVERY_FOLD)
    for key, columns in enumerate(others):
        model = model.beside(("other", key), model.products.block(("other", key), columns))
    torques = [
        model.products.block(
            (name, id(each)), {j: (rows @ own)[:, None] for j, rows in each.columns.items()}
        )
        for name, each, own in (
            ("this", this.candidate, this.candidate.coefficients),
            ("that", other, other.coefficients),
        )
    ]
    one, two = (model.view(block) for block in torques)
    energy = float(one.left[0, 0] * two.left[0, 0])
    shared = set(torques[0].white) & set(torques[1].white)
    if energy <= 0.0 or not shared:
        return 0.0
    inner = sum(float(np.sum(model.products.between(j, *torques))) for j in shared)
    inner -= float((one.shared.T @ two.shared)[0, 0])
    return float(min(abs(inner) / np.sqrt(energy), 1.0))
