"""What each accepted effect cannot be distinguished from: a model confidence set for its place.

Each alternative takes the effect's place beside the others, everything is fitted again without a
block of time and predicts it. Those that do not predict worse, at 5 %, are indistinguishable.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.candidate import Candidate
from idim_iv_ros.diagnosis.structural.likelihood import Columns, NoiseModel, Regression
from idim_iv_ros.estimation.r_factor import r_factor
from idim_iv_ros.statistics.model_confidence_set import model_confidence_set
from idim_iv_ros.types import FloatArray, IntArray

SIZE = 0.05
# A block lasts at least so long, s; there are at most so many.
_LEAST_BLOCK, _MOST_BLOCKS = 5.0, 24
_FEWEST_BLOCKS = 4
_SEED = 20110
_LEAST = 1e-6  # singular value, unit columns taken, of a direction that is excited


def indistinguishable(
    data: Baseline,
    others: Regression,
    noise_models: Sequence[NoiseModel],
    accepted: Candidate,
    alternatives: Sequence[Candidate],
) -> tuple[Candidate, ...]:
    """Return the alternatives that predict held-out blocks no worse than the accepted effect's set.

    Parameters
    ----------
    others
        The refit with all other accepted effects.
    noise_models
        Of the fit with the accepted effect.
    """
    if not alternatives:
        return ()
    blocks = blocks_of(data)
    models = [accepted.columns, *(each.columns for each in alternatives)]
    losses = held_out_losses(others, noise_models, models, blocks)
    kept = model_confidence_set(losses, SIZE, seed=_SEED).included
    return tuple(each for number, each in enumerate(alternatives, 1) if number in kept)


def blocks_of(data: Baseline) -> list[IntArray]:
    """Block of every row of every joint: equal stretches of each recording, at least 5 s."""
    lengths = [len(motion.kept) for motion in data.motions]
    seconds = sum(lengths) / data.row_rate
    wanted = float(np.clip(seconds / _LEAST_BLOCK, _FEWEST_BLOCKS, _MOST_BLOCKS))
    counts = [max(1, round(wanted * length / sum(lengths))) for length in lengths]
    first = np.concatenate([[0], np.cumsum(counts)])
    made = []
    for recording, place in zip(data.recordings, data.places, strict=True):
        share = place * np.array(counts)[recording] / np.array(lengths)[recording]
        made.append(first[recording] + share.astype(np.int64))
    return made


def held_out_losses(
    regression: Regression,
    noise_models: Sequence[NoiseModel],
    models: Sequence[Columns],
    blocks: Sequence[IntArray],
) -> FloatArray:
    """Half the squared whitened error of each block, predicted from the others: (b, m).

    That is the negative log predictive density, up to what all models share.
    """
    count = 1 + max(int(block.max()) for block in blocks)
    whitened = []
    for joint, (rows, noise) in enumerate(zip(regression.joints, noise_models, strict=True)):
        matrix, places = regression.wide(joint)
        full = np.zeros((len(rows.torque), regression.total + 1))
        full[:, places] = matrix
        full[:, -1] = rows.torque
        whitened.append(noise.apply(full, rows.runs))
    losses = np.zeros((count, len(models)))
    for number, columns in enumerate(models):
        width = next(iter(columns.values())).shape[1]
        tall = []
        for joint, (rows, noise) in enumerate(zip(regression.joints, noise_models, strict=True)):
            own = (
                noise.apply(columns[joint], rows.runs)
                if joint in columns
                else np.zeros((len(rows.torque), width))
            )
            tall.append(np.column_stack([whitened[joint][:, :-1], own, whitened[joint][:, -1]]))
        parts = [
            np.vstack([rows[block == k] for rows, block in zip(tall, blocks, strict=True)])
            for k in range(count)
        ]
        factors = [r_factor(part) for part in parts]
        for k, part in enumerate(parts):
            factor = r_factor(np.vstack([each for j, each in enumerate(factors) if j != k]))
            solution = _solved(factor)
            losses[k, number] = 0.5 * float(np.sum((part[:, -1] - part[:, :-1] @ solution) ** 2))
    return losses


def _solved(factor: FloatArray) -> FloatArray:
    norms = np.linalg.norm(factor[:, :-1], axis=0)
    scale = 1.0 / np.where(norms > 0.0, norms, 1.0)
    found = np.linalg.lstsq(factor[:, :-1] * scale, factor[:, -1], rcond=_LEAST)[0]
    return np.asarray(scale * found)
