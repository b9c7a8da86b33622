"""Whether references are those of the joints: the joints that follow them say so."""

from collections.abc import Iterator, Sequence

import numpy as np

from idim_iv_ros.types import FloatArray

_RESTING = 1e-3  # rad (m) of standard deviation, below which nothing follows anything
_MOVING = 0.05  # of the largest, from which on a joint is asked
_SAME_MOTION = 0.9  # correlation, from which on a factor between two motions is one of units
_ANOTHER_MOTION = 0.2  # correlation, below which a joint does not follow its reference
_FACTOR = 10.0  # beyond what a soft loop makes
_REPEATED = 1e-4  # of a motion: no loop follows its reference so closely
_MOST_LATE = 5  # samples by which a repeated motion may come later


def wrong_references(
    position: FloatArray, reference: FloatArray, joints: Sequence[str]
) -> Iterator[tuple[int, str]]:
    """Yield joints whose reference has another unit, or is that of another joint, and why.

    A lag, an offset and a soft loop are neither. `position`, `reference`: (s, n_joints).
    """
    moved, asked = position - position.mean(axis=0), reference - reference.mean(axis=0)
    spreads = np.std(moved, axis=0), np.std(asked, axis=0)
    alike = moved.T @ asked / len(moved) / np.maximum(np.outer(*spreads), 1e-300)
    moving = np.minimum(*spreads) > np.maximum(_RESTING, _MOVING * spreads[0].max())
    same = np.diag(alike)
    for joint in np.flatnonzero(moving).tolist():
        nearest, factor = int(np.argmax(alike[joint])), spreads[1][joint] / spreads[0][joint]
        if same[joint] < -_SAME_MOTION:
            yield joint, "its references have the opposite sign of its motion"
        elif same[joint] > _SAME_MOTION and not 1.0 / _FACTOR < factor < _FACTOR:
            yield joint, f"its references are {factor:.2g} times its motion: another unit?"
        elif (
            max(same[joint], same[nearest]) < _ANOTHER_MOTION
            and alike[joint, nearest] > _SAME_MOTION
        ):
            yield joint, f"it moves as the references of {joints[nearest]} say: another order?"


def repeats_motion(position: FloatArray, reference: FloatArray) -> bool:
    """Whether references are the measured positions, or those of a few samples before.

    A motion comes after its reference, and never so near to it. `position`, `reference`: (s,
    n_joints).
    """
    spreads = np.std(position, axis=0)
    moving = spreads > max(_RESTING, _MOVING * float(spreads.max(initial=0.0)))
    if not moving.any() or len(position) <= _MOST_LATE + 1:
        return False
    later, spreads = reference[_MOST_LATE:, moving], spreads[moving]
    apart = [
        np.std(later - position[_MOST_LATE - lag : len(position) - lag, moving], axis=0) / spreads
        for lag in range(_MOST_LATE + 1)
    ]
    return bool(np.min(apart, axis=0).max() < _REPEATED)
