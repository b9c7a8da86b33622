"""p-values on the recording's own null: how well would the best of all candidates do by chance?

A parametric bootstrap. Recordings are simulated from the model without a cause and with the noise
of the final fit. Whitened, their residual is white noise, and what the model leaves of the whitened
candidates are fixed columns: one product of matrices gives the scores of every shape in every draw.
The largest support over the whole catalogue is kept, as the search would: so the choice among all
candidates is part of the p-value, and correlated candidates do not count twice.

The noise models are fitted again in every draw; `benchmarks/false_alarms.py` compares what is
claimed with what happens. Shapes are those of the grids on both sides: refinements count neither
for the cause nor for chance.
"""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.structural.fold_model import FoldModel, orthonormal
from idim_iv_ros.diagnosis.structural.fold_search import cost, own_joints
from idim_iv_ros.diagnosis.structural.likelihood import Regression, noise_model
from idim_iv_ros.diagnosis.structural.menu import Menu
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray, IntArray

_SEED = 50110

SingleArray = NDArray[np.float32]  # half the time of double precision, for what is noise


def null_noise(
    regression: Regression,
    noise_models: Sequence[AutoregressiveModel],
    folds: Sequence[IntArray],
    seed: int = _SEED,
) -> list[SingleArray]:
    """Whitened noise (r_j, draws) of each joint, with the errors of noise models fitted to it.

    Each draw has the noise of the model. As in a diagnosis, its noise model is fitted to what the
    joint's own columns leave, and whitens it: where a spectrum is estimated too low, candidates
    of that frequency score too high, by chance. None at rows that belong to no fold.
    """
    random = np.random.default_rng(seed)
    count = int(settings.NULL_DRAWS)
    made = []
    for rows, noise, fold in zip(regression.joints, noise_models, folds, strict=True):
        white = random.standard_normal((len(fold), count))
        basis = np.linalg.qr(noise.standardized(rows.matrix, rows.segments))[0]
        polynomial = np.append(1.0, noise.coefficients)
        series, left = (
            scipy.signal.lfilter([1.0], polynomial, each, axis=0)
            for each in (white, white - basis @ (basis.T @ white))
        )
        again = np.empty((len(fold), count), np.float32)
        for draw in range(count):
            fitted = noise_model(left[:, draw], rows.segments)
            again[:, draw] = fitted.standardized(series[:, draw], rows.segments)
        again[fold < 0] = 0.0
        made.append(again)
    return made


def null_supports(model: FoldModel) -> FloatArray:
    """Largest support (draws,) of any admissible shape beside a model, by chance.

    Parameters
    ----------
    model
        With everything but the cause, of all folds; its products have draws.
    """
    products, menu = model.products, model.products.menu
    seen = _coordinates(model)
    count = seen.shape[1]
    right = np.zeros((menu.total, count))
    for joint, places in menu.places.items():
        right[places] += products.drawn[joint]
    right -= model.shared.T @ seen
    best = np.full(count, -np.inf)
    for width, (starts, which) in menu.by_width.items():
        columns = starts[:, None] + np.arange(width)
        turn = orthonormal(model.left[columns, :width], model.energy[columns], stacked=True)
        found = np.matmul(turn.transpose(0, 2, 1), right[columns])  # (m, rank, draws)
        supports = 0.5 * np.sum(found**2, axis=1) - costs(model, which)[:, None]
        for draw in range(count):
            for k in np.argsort(-supports[:, draw])[:_TRIES]:
                if supports[k, draw] <= best[draw]:
                    break
                entry, shape = menu.entries[which[k][0]], which[k][1]
                if entry.effect.admissible(entry.shapes[shape], turn[k] @ found[k, :, draw]):
                    best[draw] = supports[k, draw]
                    break
    return best


_TRIES = 50  # shapes of a draw whose coefficients are looked at, the best first


def costs(model: FoldModel, which: Sequence[tuple[int, int]]) -> FloatArray:
    """Cost of shapes, named by entry and place in it: see `Candidate.cost`."""
    menu: Menu = model.products.menu
    rows = model.products.rows @ model.weights
    made: dict[int, float] = {}
    for number, shape in which:
        if number not in made:
            entry = menu.entries[number]
            count = int(sum(rows[joint] for joint in own_joints(entry.place)))
            made[number] = cost(entry.numbers(entry.shapes[shape]), count, entry.tried)
    return np.array([made[number] for number, _ in which])


def largest_support(model: FoldModel, key: tuple[str, int, int | None] | None = None) -> float:
    """Largest support of admissible shapes of the recording itself; of one effect and place.

    Parameters
    ----------
    key
        Name of the effect and joints of its place; None: of all.
    """
    largest = -np.inf
    for width, (values, coefficients) in model.scores().items():
        which = model.products.menu.by_width[width][1]
        supports = 0.5 * values - costs(model, which)
        for k in np.argsort(-supports):
            if supports[k] <= largest:
                break
            entry, shape = model.products.menu.entries[which[k][0]], which[k][1]
            place = entry.place
            if key is not None and key != (entry.effect.name, place.joint, place.other):
                continue
            if entry.effect.admissible(entry.shapes[shape], coefficients[k]):
                largest = float(supports[k])
                break
    return largest


def p_value(observed: float, null: FloatArray) -> float:
    """Share of draws that do as well, the recording being one of them: ≥ 1 / (draws + 1)."""
    return (1.0 + int(np.sum(null >= observed))) / (1.0 + len(null))


def _coordinates(model: FoldModel) -> FloatArray:
    """Coordinates (n, draws) of the noise in the model's orthonormal basis."""
    products = model.products
    inner = np.zeros((products.total, products.draws[0].shape[1]))
    for rows, white, noise in zip(products.joints, products.white, products.draws, strict=True):
        inner[rows.columns] += white[:, :-1].T @ noise
    basis = model.basis
    seen = scipy.linalg.solve_triangular(basis.upper, inner[basis.kept], trans="T")
    for each in model.accepted:
        block = products.block(each.key, {})
        own = sum(rows.T @ products.draws[joint] for joint, rows in block.white.items())
        seen = np.vstack([seen, each.turn.T @ (own - each.shared.T @ seen)])
    return np.asarray(seen)
