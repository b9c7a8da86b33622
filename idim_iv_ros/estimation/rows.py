"""Decimated rows of the regression, joint by joint (paper, equation 5)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.model import InverseModel
from idim_iv_ros.signals import Motion

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Full-rate samples for which the regressor is held at once.
CHUNK = 60_000
# Decimated samples between two recordings on the common grid: no residual remembers that far.
_APART = 10_000

States = Callable[[int, int], tuple[FloatArray, FloatArray, FloatArray]]


@dataclass(frozen=True)
class ObservationRows:
    """The rows of one joint, from all recordings.

    Attributes
    ----------
    joint : int
    columns : (c,) int
        Base parameters on which the torque of this joint depends.
    matrix : (r, c)
        Observation matrix X (or instruments Z), only the columns above.
    torque : (r,)
        Measured torque y, decimated likewise, N m.
    runs : tuple of slice
        Stretches of rows that are contiguous in time.
    position : (r,) int
        Place of each row on the uniform decimated grid; recordings lie far apart.
    """

    joint: int
    columns: IntArray
    matrix: FloatArray
    torque: FloatArray
    runs: tuple[slice, ...]
    position: IntArray

    def __len__(self) -> int:
        return len(self.torque)


def observation_rows(model: InverseModel, motions: Sequence[Motion]) -> tuple[ObservationRows, ...]:
    """Regressor of the measured motion and measured torque, decimated in parallel.

    The full-rate regressor is made in chunks and never held whole.
    """
    blocks = [_decimated(model, motion, motion.derivatives) for motion in motions]
    torques = [motion.decimation.whole(motion.torque) for motion in motions]
    rows = []
    for joint in range(len(model.robot.joints)):
        kept = [motion.kept[:, joint] for motion in motions]
        position = _grid(kept)
        rows.append(
            ObservationRows(
                joint=joint,
                columns=np.flatnonzero(model.base.active[joint]),
                matrix=np.concatenate(
                    [block[joint] for block in blocks],
                ),
                torque=np.concatenate(
                    [torque[keep, joint] for torque, keep in zip(torques, kept, strict=True)]
                ),
                runs=_runs(position),
                position=position,
            )
        )
    return tuple(rows)


def instrument_rows(
    model: InverseModel, motions: Sequence[Motion], states: Sequence[States]
) -> tuple[FloatArray, ...]:
    """Instruments Z (equation 8): the same rows and columns, from simulated states.

    Parameters
    ----------
    states
        One for each motion: (first, last) → q, dq, ddq of those samples of the span.

    Returns
    -------
    One (r, c) array for each joint, as `ObservationRows.matrix`.
    """
    blocks = [
        _decimated(model, motion, simulated)
        for motion, simulated in zip(motions, states, strict=True)
    ]
    return tuple(
        np.concatenate([block[joint] for block in blocks])
        for joint in range(len(model.robot.joints))
    )


def _decimated(model: InverseModel, motion: Motion, states: States) -> list[FloatArray]:
    parts: list[list[FloatArray]] = [[] for _ in model.robot.joints]
    done = 0
    for chunk in motion.decimation.chunks(CHUNK):
        stop = done + len(chunk.kept)
        for joint, matrix in enumerate(model.joint_matrices(*states(chunk.first, chunk.last))):
            decimated = motion.decimation.apply(matrix, chunk)
            parts[joint].append(decimated[motion.kept[done:stop, joint]])
        done = stop
    return [np.concatenate(part) for part in parts]


def _grid(kept: Sequence[NDArray[np.bool_]]) -> IntArray:
    offset = 0
    places = []
    for keep in kept:
        places.append(offset + np.flatnonzero(keep))
        offset += len(keep) + _APART
    return np.concatenate(places)


def _runs(position: IntArray) -> tuple[slice, ...]:
    if len(position) == 0:
        return ()
    starts = np.concatenate([[0], np.flatnonzero(np.diff(position) != 1) + 1])
    stops = np.concatenate([starts[1:], [len(position)]])
    return tuple(slice(int(a), int(b)) for a, b in zip(starts, stops, strict=True))
