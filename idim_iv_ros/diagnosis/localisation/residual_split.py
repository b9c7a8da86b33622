"""Ways to split the samples of a joint, and the energy of its residual in each part."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.types import FloatArray, IntArray

_LEAST_PIECE = 16  # rows of a piece of a residual's spectrum


def since_reversal(position: FloatArray, velocity: FloatArray, slowest: float) -> FloatArray:
    """Path since the last reversal (since the start, before the first): (s,) rad (m).

    Parameters
    ----------
    position, velocity
        (s,) rad, rad/s.
    slowest
        A joint has turned once it is faster than this the other way: noise does not turn it.
    """
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(position)))])
    ways = np.where(np.abs(velocity) >= slowest, np.sign(velocity), 0.0)
    moving = np.flatnonzero(ways)
    turned = moving[1:][np.diff(ways[moving]) != 0.0]
    # The joint stood at its turning point when the speed crossed zero, a little before.
    crossing = np.flatnonzero(np.diff(np.sign(velocity)) != 0.0) + 1
    if len(crossing) and len(turned):
        turned = crossing[np.maximum(np.searchsorted(crossing, turned, side="right") - 1, 0)]
    starts = np.concatenate([[0], turned]).astype(np.int64)
    last = starts[np.searchsorted(starts, np.arange(len(position)), side="right") - 1]
    return np.asarray(path - path[last])


@dataclass(frozen=True)
class MotionAtRows:
    """What one joint does at its rows, over all recordings; (r,) each.

    Attributes
    ----------
    time : s
    position, velocity : rad, rad/s (m, m/s)
    load : N m (N)
        Torque of the rigid bodies alone.
    since_reversal : rad (m)
        Distance since the last reversal.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    load: FloatArray
    since_reversal: FloatArray


def motion_at_rows(data: Baseline, joint: int) -> MotionAtRows:
    """Take the smooth motion of one joint at the rows that count."""
    motions = data.motions
    slowest = settings.REVERSAL_SPEED * float(data.slowest[joint])

    def at_rows(values: Sequence[FloatArray]) -> FloatArray:
        kept = [part[each.decimation.kept] for part, each in zip(values, motions, strict=True)]
        return data.counting(joint, kept)

    return MotionAtRows(
        time=at_rows([each.time for each in motions]),
        position=at_rows([each.position[:, joint] for each in motions]),
        velocity=at_rows([each.velocity[:, joint] for each in motions]),
        load=at_rows([each.load[:, joint] for each in motions]),
        since_reversal=at_rows(
            [
                since_reversal(each.position[:, joint], each.velocity[:, joint], slowest)
                for each in motions
            ]
        ),
    )


_BANDS = (0.0, 0.1, 0.3, 0.6, 1.0)  # of the band of the rows


@dataclass(frozen=True)
class Axis:
    """A quantity by which the samples of a joint are split.

    Attributes
    ----------
    name : str
    values : (r,)
        At each row.
    edges : (k + 1,)
    """

    name: str
    values: FloatArray
    edges: FloatArray


@dataclass(frozen=True)
class Split:
    """Energy of one joint's residual, split along one axis.

    Attributes
    ----------
    name : str
        Of the axis.
    edges : (k + 1,)
    bins : (b, k, 2)
        Energy and weight (samples, or bandwidth) of each bin in each block of time.
    """

    name: str
    edges: FloatArray
    bins: FloatArray


def axes_of(motion: MotionAtRows, starts: Sequence[float]) -> list[Axis]:
    """Every quantity of a joint's motion by which its samples are split.

    Parameters
    ----------
    starts
        Of the recordings in the time of the session, s.
    """
    speed, load = np.abs(motion.velocity), np.abs(motion.load)
    position, time, distance = motion.position, motion.time, motion.since_reversal
    return [
        Axis("speed", speed, _logarithmic(speed, 6)),
        Axis("direction", np.sign(motion.velocity) * 0.5, np.array([-1.0, 0.0, 1.0])),
        Axis("position", position, np.linspace(position.min(), position.max(), 9)),
        Axis("load", load, np.quantile(load, np.linspace(0.0, 1.0, 6))),
        Axis("time", time, _in_recordings(time, starts, 6)),
        Axis("reversal", distance, _logarithmic(distance, 6)),
    ]


def _in_recordings(time: FloatArray, starts: Sequence[float], count: int) -> FloatArray:
    """Edges of about `count` bins with as many samples each; none holds parts of two recordings.

    Where there are as many recordings as bins, a bin holds whole ones.
    """
    recording = np.searchsorted(starts, time, side="right") - 1
    samples = np.bincount(recording, minlength=len(starts))
    used = np.flatnonzero(samples)
    if len(used) >= count:
        before = np.cumsum(samples[used]) - samples[used]
        _, firsts = np.unique(before * count // len(time), return_index=True)
        inner = [starts[int(used[first])] for first in firsts[1:]]
        return np.array([time.min(), *inner, time.max()])
    edges: list[float] = []
    for which in used:
        bins = max(1, round(count * samples[which] / len(time)))
        own = np.quantile(time[recording == which], np.linspace(0.0, 1.0, bins + 1))
        first = float(own[0]) if not edges else starts[int(which)]
        edges += [first, *own[1:-1].tolist()]
    return np.array([*edges, time.max()])


def _logarithmic(values: FloatArray, count: int) -> FloatArray:
    low, high = max(float(np.quantile(values, 0.01)), 1e-9), float(values.max())
    if high <= 1.01 * low:
        return np.array([0.0, max(high, 1e-9)])
    edges = np.geomspace(low, high, count + 1)
    edges[0] = min(float(values.min()), low)
    return np.asarray(edges)


def split(axis: Axis, residual: FloatArray, blocks: IntArray) -> Split:
    """Energy and samples of each bin of an axis in each block of time.

    Parameters
    ----------
    residual
        (r,) N m (N).
    blocks
        (r,) block of each row (`time_blocks`).
    """
    count = len(axis.edges) - 1
    bins = np.clip(np.searchsorted(axis.edges, axis.values, side="right") - 1, 0, count - 1)
    _, block = np.unique(blocks, return_inverse=True)
    place = block * count + bins
    size = (int(block.max()) + 1) * count
    energy = np.bincount(place, weights=residual**2, minlength=size)
    samples = np.bincount(place, minlength=size).astype(float)
    return Split(axis.name, axis.edges, np.stack([energy, samples], axis=1).reshape(-1, count, 2))


def bands(
    residual: FloatArray, runs: Sequence[slice], row_rate: float, edge: float
) -> Split | None:
    """Energy of a residual in bands of frequency, from stretches of a second; weight: bandwidth.

    None where there are too few stretches.

    Parameters
    ----------
    residual
        (r,) N m (N).
    runs
        Rows without a gap in time.
    row_rate
        Hz.
    edge
        Share of the rows' Nyquist frequency that the decimation passes.
    """
    length = int(settings.LEAST_TIME_BLOCK * row_rate)
    if length < _LEAST_PIECE:
        return None
    pieces = [
        residual[start : start + length]
        for run in runs
        for start in range(run.start, run.stop - length + 1, length)
    ]
    if not pieces:
        return None
    window = np.hanning(length)
    power = np.abs(np.fft.rfft(np.array(pieces) * window, axis=1)) ** 2
    frequency = np.fft.rfftfreq(length, 1.0 / row_rate)
    edges = np.array(_BANDS) * 0.5 * edge * row_rate
    # A line of the spectrum covers half a line on either side of it.
    line = frequency[1]
    bins = np.zeros((len(pieces), len(edges) - 1, 2))
    for k in range(len(edges) - 1):
        low, high = frequency - 0.5 * line, frequency + 0.5 * line
        inside = np.maximum(
            np.minimum(high, edges[k + 1]) - np.maximum(np.maximum(low, 0.0), edges[k]), 0.0
        )
        bins[:, k, 0] = power @ (inside / line)
        bins[:, k, 1] = inside.sum()
    return Split("frequency", edges, bins)
