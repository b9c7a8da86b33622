"""Decimated rows of the regression from filtered motions (paper, equation 5)."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise

import numpy as np

from idim_iv_ros.estimation.qr import streamed_r_factor
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals.autoregression import Segments
from idim_iv_ros.signals.motion import Motion
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

# Full-rate samples for which the regressor is held at once.
CHUNK = 30_000
# Decimated samples between two recordings on the common grid: no residual remembers that far.
_APART = 10_000
_THREADS = 2

States = Callable[[int, int], tuple[FloatArray, FloatArray, FloatArray]]


def row_blocks(
    model: InverseModel, motion: Motion, states: States
) -> Iterator[tuple[FloatArray, ...]]:
    """Decimated rows that count, (r_j, c_j) for each joint, chunk by chunk.

    The full-rate regressor is never in memory as a whole.

    `states`: (first, last) → q, dq, ddq of those samples of the motion's span.
    """
    for chunk in motion.decimation.chunks(CHUNK):
        full = model.joint_matrices(*states(chunk.first, chunk.last))
        decimate = partial(motion.decimation.apply, chunk=chunk)
        with ThreadPoolExecutor(_THREADS) as pool:  # the filter frees the lock
            decimated = list(pool.map(decimate, full))
        rows = zip(decimated, motion.kept[chunk.places].T, strict=True)
        yield tuple(matrix[counts] for matrix, counts in rows)


def torque_rows(motion: Motion) -> list[FloatArray]:
    """Decimated torque of the samples that count, one (r_j,) array for each joint."""
    pairs = zip(motion.torque.T, motion.kept.T, strict=True)
    return [motion.decimation.whole(torque)[kept] for torque, kept in pairs]


def observation_rows(model: InverseModel, motions: Sequence[Motion]) -> tuple[JointRows, ...]:
    """Regressor of the measured motion and measured torque, decimated in parallel."""
    matrices = instrument_rows(model, motions, [motion.derivatives for motion in motions])
    torques = zip(*map(torque_rows, motions), strict=True)
    rows = []
    for joint, (matrix, torque) in enumerate(zip(matrices, torques, strict=True)):
        position = _grid([motion.kept[:, joint] for motion in motions])
        columns, segments = np.flatnonzero(model.base.active[joint]), _segments(position)
        name = model.robot.joints[joint]
        rows.append(JointRows(matrix, np.concatenate(torque), columns, segments, name, position))
    return tuple(rows)


def streamed_rows(model: InverseModel, motions: Sequence[Motion]) -> tuple[JointRows, ...]:
    """Reduced rows (`JointRows.reduced`) of recordings, made without all rows in memory."""
    columns = [np.flatnonzero(active) for active in model.base.active]
    factors = [np.zeros((0, len(active) + 1)) for active in columns]
    for motion in motions:
        torques = torque_rows(motion)
        for block in row_blocks(model, motion, motion.derivatives):
            for joint, matrix in enumerate(block):
                torque, torques[joint] = np.split(torques[joint], [len(matrix)])
                rows = np.column_stack([matrix, torque])
                factors[joint] = streamed_r_factor((factors[joint], rows), rows.shape[1])
    counts = np.sum([motion.kept.sum(axis=0) for motion in motions], axis=0).tolist()
    parts = zip(model.robot.joints, factors, columns, counts, strict=True)
    return tuple(
        JointRows(factor[:, :-1], factor[:, -1], places, name=name, represented=count)
        for name, factor, places, count in parts
    )


def instrument_rows(
    model: InverseModel, motions: Sequence[Motion], states: Sequence[States]
) -> tuple[FloatArray, ...]:
    """Instruments Z (equation 8) from simulated states, one (r, c) array a joint as the matrix.

    `states`: one for each motion: (first, last) → q, dq, ddq of those samples of the span.
    """
    counts = np.sum([motion.kept.sum(axis=0) for motion in motions], axis=0)
    widths = [int(active.sum()) for active in model.base.active]
    matrices = tuple(map(np.empty, zip(counts.tolist(), widths, strict=True)))
    rest = list(matrices)  # of the rows, to be filled
    for motion, simulated in zip(motions, states, strict=True):
        for block in row_blocks(model, motion, simulated):
            for joint, part in enumerate(block):
                rest[joint][: len(part)] = part
                rest[joint] = rest[joint][len(part) :]
    return matrices


def segments_of(kept: Sequence[BoolArray]) -> Segments:
    """Runs of neighbouring samples in several stretches, numbered among those that are kept."""
    return _segments(_grid(kept))


def _grid(kept: Sequence[BoolArray]) -> IntArray:
    begins = np.cumsum([0, *(len(keep) + _APART for keep in kept[:-1])])
    return np.concatenate([b + np.flatnonzero(k) for b, k in zip(begins, kept, strict=True)])


def _segments(position: IntArray) -> Segments:
    cuts = [0, *(np.flatnonzero(np.diff(position) != 1) + 1).tolist(), len(position)]
    return Segments(slice(a, b) for a, b in pairwise(cuts) if b > a)
