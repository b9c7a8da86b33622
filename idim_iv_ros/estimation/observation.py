"""Decimated rows of the regression from filtered motions (paper, equation 5)."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np

from idim_iv_ros.estimation.qr import streamed_r_factor
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals import Motion
from idim_iv_ros.signals.autoregression import Segments
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
    return [
        motion.decimation.whole(torque)[kept]
        for torque, kept in zip(motion.torque.T, motion.kept.T, strict=True)
    ]


def observation_rows(model: InverseModel, motions: Sequence[Motion]) -> tuple[JointRows, ...]:
    """Regressor of the measured motion and measured torque, decimated in parallel."""
    matrices = instrument_rows(model, motions, [motion.derivatives for motion in motions])
    torques = zip(*map(torque_rows, motions), strict=True)
    rows = []
    for joint, (matrix, torque) in enumerate(zip(matrices, torques, strict=True)):
        position = _grid([motion.kept[:, joint] for motion in motions])
        rows.append(
            JointRows(
                matrix=matrix,
                torque=np.concatenate(torque),
                columns=np.flatnonzero(model.base.active[joint]),
                segments=_segments(position),
                name=model.robot.joints[joint],
                position=position,
            )
        )
    return tuple(rows)


def streamed_rows(model: InverseModel, motions: Sequence[Motion]) -> tuple[JointRows, ...]:
    """Reduced rows (`JointRows.reduced`) of recordings, made without all rows in memory."""
    columns = [np.flatnonzero(active) for active in model.base.active]
    factors = [np.zeros((0, len(active) + 1)) for active in columns]
    counts = [0] * len(columns)
    for motion in motions:
        torques = torque_rows(motion)
        done = [0] * len(columns)
        for block in row_blocks(model, motion, motion.derivatives):
            for joint, matrix in enumerate(block):
                torque = torques[joint][done[joint] : done[joint] + len(matrix)]
                rows = np.column_stack([matrix, torque])
                factors[joint] = streamed_r_factor((factors[joint], rows), rows.shape[1])
                done[joint] += len(matrix)
        counts = [before + more for before, more in zip(counts, done, strict=True)]
    return tuple(
        JointRows(factor[:, :-1], factor[:, -1], places, name=name, represented=count)
        for name, factor, places, count in zip(
            model.robot.joints, factors, columns, counts, strict=True
        )
    )


def instrument_rows(
    model: InverseModel, motions: Sequence[Motion], states: Sequence[States]
) -> tuple[FloatArray, ...]:
    """Instruments Z (equation 8): the same rows and columns, from simulated states.

    `states`: one for each motion: (first, last) → q, dq, ddq of those samples of the span.

    Returns one (r, c) array for each joint, as `JointRows.matrix`.
    """
    joints = range(len(model.robot.joints))
    counts = [sum(int(motion.kept[:, joint].sum()) for motion in motions) for joint in joints]
    matrices = tuple(
        np.empty((count, int(active.sum())))
        for count, active in zip(counts, model.base.active, strict=True)
    )
    done = [0] * len(counts)
    for motion, simulated in zip(motions, states, strict=True):
        for block in row_blocks(model, motion, simulated):
            for joint, part in enumerate(block):
                matrices[joint][done[joint] : done[joint] + len(part)] = part
                done[joint] += len(part)
    return matrices


def segments_of(kept: Sequence[BoolArray]) -> Segments:
    """Runs of neighbouring samples in several stretches, numbered among those that are kept."""
    return _segments(_grid(kept))


def _grid(kept: Sequence[BoolArray]) -> IntArray:
    offset = 0
    places = []
    for keep in kept:
        places.append(offset + np.flatnonzero(keep))
        offset += len(keep) + _APART
    return np.concatenate(places)


def _segments(position: IntArray) -> Segments:
    if len(position) == 0:
        return Segments()
    starts = np.concatenate([[0], np.flatnonzero(np.diff(position) != 1) + 1])
    stops = np.concatenate([starts[1:], [len(position)]])
    return Segments(slice(int(a), int(b)) for a, b in zip(starts, stops, strict=True))
