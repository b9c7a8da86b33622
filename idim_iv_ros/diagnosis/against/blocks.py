"""Blocks of time of two sets, predicted from all the others: what a model is worth on new data."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, r_factor
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray, IntArray


@dataclass(frozen=True)
class BlockErrors:
    """Errors of one model on blocks that it was not fitted to.

    Attributes
    ----------
    losses : (blocks,)
        Half the squared whitened error: the negative log predictive density, up to what all models
        share.
    residuals : tuple of (r_j,)
        N m (N), not whitened.
    """

    losses: FloatArray
    residuals: tuple[FloatArray, ...]


def time_blocks_of(data: Baseline, first: int) -> list[IntArray]:
    """Block of each row (r_j,) of every joint: equal stretches of each set.

    Parameters
    ----------
    first
        Recordings of the first set; a block lies in one recording.
    """
    lengths = np.array([len(motion.kept) for motion in data.motions])
    counts = np.concatenate([_counts(lengths[:first], data), _counts(lengths[first:], data)])
    starts = np.concatenate([[0], np.cumsum(counts)])
    return [
        starts[recording] + place * counts[recording] // lengths[recording]
        for recording, place in zip(data.recordings, data.places, strict=True)
    ]


def _counts(lengths: IntArray, data: Baseline) -> IntArray:
    """How many blocks each recording of one set has."""
    seconds = float(lengths.sum()) / data.row_rate
    wanted = float(
        np.clip(
            seconds / settings.CONFIDENCE_LEAST_BLOCK,
            settings.CONTRAST_FEWEST_BLOCKS,
            settings.CONTRAST_MOST_BLOCKS,
        )
    )
    return np.asarray(np.maximum(np.round(wanted * lengths / lengths.sum()), 1), dtype=np.int64)


def block_errors(
    regression: Regression,
    noise_models: Sequence[AutoregressiveModel],
    blocks: Sequence[IntArray],
) -> BlockErrors:
    """Predict every block by a fit to all the others."""
    tables, plain = [], []
    for rows, noise in zip(regression.extended, noise_models, strict=True):
        table = np.zeros((len(rows), regression.total + 1))
        table[:, rows.columns] = rows.matrix
        table[:, -1] = rows.torque
        plain.append(table)
        tables.append(noise.standardized(table, rows.segments))
    count = 1 + max(int(block.max()) for block in blocks)
    factors = [
        r_factor(np.vstack([t[b == k] for t, b in zip(tables, blocks, strict=True)]))
        for k in range(count)
    ]
    losses = np.zeros(count)
    residuals = [np.zeros(len(table)) for table in plain]
    for k in range(count):
        # What only this block shows stays finite.
        parts = [settings.FOLD_LEAK * each if j == k else each for j, each in enumerate(factors)]
        factor = r_factor(np.vstack(parts))
        basis = independent_basis(factor[:, :-1], tolerance=NOT_SHOWN)
        solution = np.append(-basis.solve(factor[:, -1], regression.total), 1.0)
        for joint, block in enumerate(blocks):
            inside = block == k
            losses[k] += 0.5 * float(np.sum((tables[joint][inside] @ solution) ** 2))
            residuals[joint][inside] = plain[joint][inside] @ solution
    return BlockErrors(losses, tuple(residuals))


def clearly_better(gains: FloatArray) -> bool:
    """Whether held-out blocks speak for a model: most of those that say anything, not one alone.

    An effect shows where its motion is: in a chirp, and not in slow sweeps beside it. Blocks where
    two models predict the same have no vote, and a mean over all would ask that all gain.
    """
    votes = gains[np.abs(gains) >= settings.CONTRAST_LEAST_VOTE]
    positive = int(np.sum(votes > 0.0))
    if positive < settings.CONTRAST_FEWEST_VOTES:
        return False
    most = positive >= settings.HELD_OUT_LEAST_FOLDS * len(votes)
    return bool(most and float(gains.sum() - gains.max()) > 0.0)
