"""What no model can explain: the noise between repeats of one motion, or a lower bound."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from scipy.signal import fftconvolve

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.estimation.likelihood import Fit
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.types import FloatArray, IntArray

_COARSE = 5.0  # tolerances before the shift between two repeats is refined
_HAS_LEFT = 0.3  # spreads that a motion is away from itself before it can repeat itself
_LEAST_MOTION = 0.1  # of the variance, below which nothing moves

REPEATS, LOWER_BOUND = "repeats", "lower bound"


@dataclass(frozen=True)
class Repeat:
    """Sample k of one recording's references is commanded again as sample k + lag of another.

    Or of itself. Samples are those of the fastest recording.
    """

    first: int
    second: int
    lag: int


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of one joint in the band of the rows, and what it is made of."""

    sigma: float | None  # N m (N)
    origin: str  # ``repeats`` or ``lower bound``
    note: str


def noise_floors(data: Baseline, fit: Fit, repeats: Sequence[Repeat]) -> tuple[NoiseFloor, ...]:
    """Noise of every joint, from repeats where there are any (`repeats_of`).

    Between repeats, residuals differ by √2 times the noise. What the model's own columns explain of
    the difference is taken out first: friction or an offset that changed in between is drift, and
    not noise. Rows that do not fall on the same instant are matched to half a row.

    `fit`: the best one there is: without repeats its innovations are the lower bound, as far as no
    effect is left in them.
    """
    floors = []
    for joint, rows in enumerate(data.rows):
        if rows.left_out:
            floors.append(NoiseFloor(None, LOWER_BOUND, ""))
            continue
        energy = np.zeros(2)  # and its degrees of freedom
        for repeat in repeats:
            one, two = _matching(data, joint, repeat)
            if len(one) >= settings.LEAST_ROWS + rows.matrix.shape[1]:
                difference = fit.residuals[joint][one] - fit.residuals[joint][two]
                energy += difference_energy(difference, rows.matrix[one])
        sigma, origin = float(fit.noise_models[joint].sigma), LOWER_BOUND
        note = (
            "no recording repeats another or itself: innovations of the last residual, below "
            "the noise if that residual is all noise, above it if an effect is left in it"
        )
        if energy[1] > 0.0:
            sigma, origin = float(np.sqrt(0.5 * energy[0] / energy[1])), REPEATS
            note = "difference of repeats, less what changed parameters of the model explain"
        floors.append(NoiseFloor(sigma, origin, note))
    return tuple(floors)


def difference_energy(difference: FloatArray, drifting: FloatArray) -> tuple[float, float]:
    """Energy of a difference (n,) beyond columns (n, c), and its degrees of freedom."""
    basis = independent_basis(np.column_stack([drifting, np.ones(len(difference))]))
    rest = basis.remove(difference)
    return float(rest @ rest), float(len(difference) - basis.rank)


def repeats_of(data: Baseline) -> tuple[Repeat, ...]:
    """Repeats among the references of all recordings; none where references are missing."""
    fastest = max(motion.signals.rate for motion in data.prepared.motions)
    references = []
    for motion in data.prepared.motions:
        reference, rate = motion.signals.position_reference, motion.signals.rate
        if reference is None:
            return ()
        if rate < fastest:  # linearly between its samples
            time = np.arange(int((len(reference) - 1) * fastest / rate) + 1) / fastest
            sampled = np.arange(len(reference)) / rate
            reference = np.column_stack([np.interp(time, sampled, q) for q in reference.T])
        references.append(reference)
    return find_repeats(references, fastest, data.row_rate)


def find_repeats(
    references: Sequence[FloatArray], rate: float, coarse_rate: float
) -> tuple[Repeat, ...]:
    """Pairs of recordings, and periods inside one, with the same references (n_samples, n_joints).

    `rate`, `coarse_rate`: Hz, of the samples, and at which the shift is looked for first.
    """
    stride = max(1, round(rate / coarse_rate))
    return tuple(
        Repeat(i, j, lag)
        for i, j in combinations_with_replacement(range(len(references)), 2)
        if (lag := _lag(references[i], references[j], rate, stride, itself=i == j)) is not None
    )


def _lag(one: FloatArray, two: FloatArray, rate: float, stride: int, *, itself: bool) -> int | None:
    """Shift at which two references agree best; None where they never agree for long enough.

    That of a reference to `itself` is the smallest after it has left itself, however much of the
    recording comes before.
    """
    share = 0.0 if itself else settings.REPEAT_LEAST_SHARE * min(len(one), len(two))
    least = max(settings.REPEAT_LEAST_OVERLAP * rate, share)
    lags, distance, overlap = _distances(one[::stride], two[::stride])
    usable = overlap * stride >= least
    if itself:
        away = lags[(lags > 0) & (distance > _HAS_LEFT)]
        usable &= lags > min(away, default=len(one))
    close = np.flatnonzero(usable & (distance < _COARSE * settings.REPEAT_TOLERANCE))
    if len(close) == 0:
        return None
    if itself:
        close = np.split(close, np.flatnonzero(np.diff(close) > 1) + 1)[0]
    return _refined(one, two, int(lags[close][np.argmin(distance[close])]) * stride, stride)


def _distances(one: FloatArray, two: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """For each shift, the rms difference as a share of the spread, and the samples it is over.

    Infinite where the references hardly move in the overlap.
    """
    centre = one.mean(axis=0)
    a, b = one - centre, two - centre
    lags = np.arange(-(len(a) - 1), len(b))
    cross = sum(fftconvolve(b[:, j], a[::-1, j]) for j in range(a.shape[1]))
    low, high = np.maximum(0, -lags), np.minimum(len(a), len(b) - lags)
    overlap = (high - low).astype(float)
    squares_a, squares_b, plain = (
        np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        for values in (np.sum(a**2, axis=1), np.sum(b**2, axis=1), a)
    )
    energy_a = squares_a[high] - squares_a[low]
    energy_b = squares_b[high + lags] - squares_b[low + lags]
    mean = (plain[high] - plain[low]) / overlap[:, None]
    spread = energy_a / overlap - np.sum(mean**2, axis=1)
    moving = spread > _LEAST_MOTION * float(np.sum(np.var(one, axis=0)))
    squares = np.maximum(energy_a + energy_b - 2.0 * cross, 0.0) / overlap
    ratio = squares / np.where(moving, spread, 1.0)
    return lags, np.where(moving, np.sqrt(ratio), np.inf), overlap


def _refined(one: FloatArray, two: FloatArray, lag: int, stride: int) -> int | None:
    """The best shift near a coarse one; the whole of `_distances` would take much memory."""

    def distance(shift: int) -> float:
        low, high = max(0, -shift), min(len(one), len(two) - shift)
        part = one[low:high]
        squares = np.sum((part - two[low + shift : high + shift]) ** 2)
        return float(np.sqrt(squares / np.sum((part - part.mean(axis=0)) ** 2)))

    best = min(range(lag - stride, lag + stride + 1), key=distance)
    return best if distance(best) < settings.REPEAT_TOLERANCE else None


def _matching(data: Baseline, joint: int, repeat: Repeat) -> tuple[IntArray, IntArray]:
    """Rows of a joint that the repeat makes equal, in pairs."""
    motions = data.prepared.motions
    fastest = max(motion.signals.rate for motion in motions)
    numbers, samples = [], []
    for recording in (repeat.first, repeat.second):
        motion, scale = motions[recording], fastest / motions[recording].signals.rate
        kept = motion.decimation.kept[motion.kept[:, joint]]
        numbers.append(np.flatnonzero(data.recordings[joint] == recording))
        samples.append(scale * (motion.span.start + kept))
    if len(numbers[1]) == 0:
        return numbers[1], numbers[1]
    wanted, others = samples[0] + repeat.lag, samples[1]
    nearest = np.searchsorted(0.5 * (others[1:] + others[:-1]), wanted)
    close = 2 * np.abs(others[nearest] - wanted) <= scale * motion.decimation.factor
    return numbers[0][close], numbers[1][nearest[close]]
