"""What each accepted effect cannot be distinguished from: a model confidence set for its place.

Each alternative takes the effect's place beside the others, everything is fitted again without a
block of time and predicts it. Those that predict no worse are indistinguishable.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.candidate import Candidate
from idim_iv_ros.diagnosis.structural.likelihood import Columns, Regression
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, r_factor
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.statistics.model_confidence_set import model_confidence_set
from idim_iv_ros.types import FloatArray, IntArray

_SEED = 20110


def confidence_set(
    data: Baseline,
    others: Regression,
    noise_models: Sequence[AutoregressiveModel],
    accepted: Candidate,
    alternatives: Sequence[Candidate],
) -> tuple[Candidate, ...]:
    """Return the alternatives that predict held-out blocks as well as the best of all.

    Parameters
    ----------
    others
        The refit with all other accepted effects.
    noise_models
        Of the fit with the accepted effect.
    """
    if not alternatives:
        return ()
    models = [accepted.columns, *(each.columns for each in alternatives)]
    losses = held_out_losses(others, noise_models, models, blocks_of(data))
    kept = model_confidence_set(losses, settings.CONFIDENCE_SET_SIZE, seed=_SEED).included
    return tuple(each for number, each in enumerate(alternatives, 1) if number in kept)


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
    regression: Regression,
    noise_models: Sequence[AutoregressiveModel],
    models: Sequence[Columns],
    blocks: Sequence[IntArray],
) -> FloatArray:
    """Half the squared whitened error of each block, predicted from the others: (b, m).

    That is the negative log predictive density, up to what all models share.
    """
    count = 1 + max(int(block.max()) for block in blocks)
    losses = np.zeros((count, len(models)))
    for number, columns in enumerate(models):
        larger = regression.with_columns(columns)
        tables = []
        for rows, noise in zip(larger.extended, noise_models, strict=True):
            table = np.zeros((len(rows), larger.total + 1))
            table[:, rows.columns] = rows.matrix
            table[:, -1] = rows.torque
            tables.append(noise.standardized(table, rows.segments))
        parts = [
            np.vstack([table[block == k] for table, block in zip(tables, blocks, strict=True)])
            for k in range(count)
        ]
        factors = [r_factor(part) for part in parts]
        for k, part in enumerate(parts):
            factor = r_factor(np.vstack([each for j, each in enumerate(factors) if j != k]))
            basis = independent_basis(factor[:, :-1], tolerance=NOT_SHOWN)
            error = part[:, -1] - part[:, :-1] @ basis.solve(factor[:, -1], larger.total)
            losses[k, number] = 0.5 * float(error @ error)
    return losses
