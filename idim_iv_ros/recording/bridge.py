"""Positions while nothing was measured: a motion without corners between what was.

These samples are left out of every estimate, but the filters look across them, the cut-offs are
chosen from the whole spectrum and the closed loop is simulated through them: a corner at the edge
of a gap is an acceleration that the robot never had.
"""

from functools import cache

import numpy as np

from idim_iv_ros.types import BoolArray, FloatArray

# Time, and samples at least, from which the speed at the edge of a gap is taken.
_EDGE, _EDGE_SAMPLES = 0.1, 8  # s
_STOP = 0.5  # s, in which a joint comes to rest in a long gap, and starts again at its end


def bridged(values: FloatArray, invented: BoolArray, rate: float) -> None:
    """Replace the invented samples between measured ones, in place.

    Parameters
    ----------
    values, invented
        (n,) of one joint.
    rate
        Hz.
    """
    edges = np.diff(np.concatenate([[False], invented, [False]]).astype(int))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    since = np.concatenate([[0], ends])  # where what is measured before each gap begins
    until = np.concatenate([begins[1:], [len(values)]])
    edge = max(_EDGE_SAMPLES, round(_EDGE * rate))
    for gap, (begin, end) in enumerate(zip(begins.tolist(), ends.tolist(), strict=True)):
        if begin == 0 or end == len(values):
            continue
        before = values[max(int(since[gap]), begin - edge) : begin]
        after = values[end : min(int(until[gap]), end + edge)]
        duration = (end - begin + 1) / rate
        # From the last measured sample to the next, with the speeds there.
        speeds = _speed(before[::-1], -rate), _speed(after, rate)
        ends_at = float(before[-1]), float(after[0])
        seconds = np.arange(1, end - begin + 1) / rate
        values[begin:end] = _curve(seconds, duration, ends_at, speeds)


def _speed(samples: FloatArray, rate: float) -> float:
    """Slope at the first sample, of a parabola (a line through few); zero for a single one."""
    if len(samples) < 2:
        return 0.0
    return float(rate * (_slope(len(samples)) @ samples))


@cache
def _slope(samples: int) -> FloatArray:
    """Weights (samples,) that give the slope at the first sample, per sample."""
    degree = 2 if samples >= _EDGE_SAMPLES else 1
    powers = np.vander(np.arange(samples, dtype=float), degree + 1, increasing=True)
    return np.asarray(np.linalg.pinv(powers)[1])


def _curve(
    seconds: FloatArray,
    duration: float,
    ends: tuple[float, float],
    speeds: tuple[float, float],
) -> FloatArray:
    """Positions at `seconds` of a motion between two positions with given speeds there."""
    if duration <= 4.0 * _STOP:
        return _cubic(seconds, duration, ends, speeds)
    # In a long gap evenly slowed down to rest, and evenly speeded up from it.
    rests = ends[0] + 0.5 * _STOP * speeds[0], ends[1] - 0.5 * _STOP * speeds[1]
    stops = _cubic(seconds, _STOP, (ends[0], rests[0]), (speeds[0], 0.0))
    moves = _cubic(seconds - _STOP, duration - 2.0 * _STOP, rests, (0.0, 0.0))
    starts = _cubic(seconds - duration + _STOP, _STOP, (rests[1], ends[1]), (0.0, speeds[1]))
    late = np.where(seconds > duration - _STOP, starts, moves)
    return np.where(seconds < _STOP, stops, late)


def _cubic(
    seconds: FloatArray,
    duration: float,
    ends: tuple[float, float],
    speeds: tuple[float, float],
) -> FloatArray:
    """Cubic polynomial with given values and slopes at 0 and `duration` (Hermite's form)."""
    u = seconds / duration
    step = ends[1] - ends[0]
    first, last = speeds[0] * duration, speeds[1] * duration
    return np.asarray(
        ends[0]
        + u * (first + u * (3.0 * step - 2.0 * first - last + u * (first + last - 2.0 * step)))
    )
