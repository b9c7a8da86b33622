"""The autoregressive model of a residual: fit it, whiten rows with it, undo that."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np
import scipy

from idim_iv_ros.compilation import entry
from idim_iv_ros.types import FloatArray, IntArray

_ROWS_PER_COEFFICIENT = 10
_LARGEST_ORDER = 100
_MEMORY_LIMIT = 5000
_UNITY = 1.0 - 1e-12


class Segments(tuple[slice, ...]):
    """Runs of rows that are contiguous in time, one behind the other.

    A search whitens the same rows thousands of times: they are checked once.
    """

    @cached_property
    def starts(self) -> IntArray:
        """First rows of all runs, and at the end that of the last (m + 1,).

        Raises ValueError: runs that overlap or leave rows out.
        """
        starts = np.array([0] + [segment.stop for segment in self], dtype=np.int64)
        for segment, start in zip(self, starts, strict=False):
            if segment.start != start or segment.stop <= start:
                raise ValueError(
                    f"segments must follow one another without gaps, {segment} does not"
                )
        return starts


@dataclass(frozen=True, eq=False)
class AutoregressiveModel:
    """ε = H(z⁻¹) ε_N with H = 1/C, C = 1 + c₁ z⁻¹ + … + c_p z⁻ᵖ (paper, equation 11, D = 1).

    The reflections hold the predictors of every lower order too, which start a segment exactly.
    """

    reflections: FloatArray  # (p,), κ₁ … κ_p of the lattice, of modulus below 1: 1/C is stable
    innovation_variance: float  # σ² of the white noise ε_N, in the squared unit of the residual

    @property
    def order(self) -> int:
        """Order p of the model, the number of its coefficients."""
        return len(self.reflections)

    @cached_property
    def coefficients(self) -> FloatArray:
        """Coefficients c₁ … c_p (p,) of C(z⁻¹), with the signs of the paper."""
        return self._predictors[-1][1:]

    @property
    def sigma(self) -> float:
        """Standard deviation of the white noise ε_N."""
        return float(np.sqrt(self.innovation_variance))

    @property
    def variance(self) -> float:
        """Variance of the residual that this model describes."""
        return self.innovation_variance / float(np.prod(1.0 - self.reflections**2))

    @property
    def predictable_share(self) -> float:
        """Share of a residual's variance that its past predicts, 1 − σ²_N / σ²_ε."""
        return 1.0 - float(np.prod(1.0 - self.reflections**2))

    def with_white_noise(self, share: float) -> "AutoregressiveModel":
        """Return the model of the same order for the residual plus white noise.

        The noise has `share` of the residual's variance: no frequency is then believed to hold
        less than about that share of the mean density.
        """
        covariance = self._autocorrelation()
        covariance[0] += share
        polynomial, energy = np.ones(1), float(covariance[0])
        reflections = []
        for order in range(1, self.order + 1):
            reflections.append(-float(polynomial @ covariance[order:0:-1]) / energy)
            polynomial = _longer(polynomial, reflections[-1])
            energy *= 1.0 - reflections[-1] ** 2
        return AutoregressiveModel(np.array(reflections), self.variance * energy)

    def standardized(self, rows: FloatArray, segments: Sequence[slice]) -> FloatArray:
        """Whiten rows (r, …) so that the residual has unit variance; see `whiten`."""
        return self._filtered(rows, segments, float(np.divide(1.0, self.sigma)), whiten_lines)

    def standardized_adjoint(self, rows: FloatArray, segments: Sequence[slice]) -> FloatArray:
        """Wᵀ rows (r, …), W being what `standardized` does: xᵀ (Wᵀ y) = (W x)ᵀ y."""
        scale = float(np.divide(1.0, self.sigma))
        return self._filtered(rows, segments, scale, whiten_lines_adjoint)

    def _autocorrelation(self) -> FloatArray:
        """(p + 1,) of lags 0 … p, from the recursion that gave the reflections."""
        correlation, energy = np.ones(1), 1.0
        for reflection, polynomial in zip(self.reflections, self._predictors, strict=False):
            predicted = float(polynomial[1:] @ correlation[:0:-1])
            correlation = np.append(correlation, -reflection * energy - predicted)
            energy *= 1.0 - reflection**2
        return correlation

    @cached_property
    def _predictors(self) -> list[FloatArray]:
        """Polynomials of order 0 … p by the Levinson recursion."""
        return list(accumulate(self.reflections, _longer, initial=np.ones(1)))

    @cached_property
    def _start(self) -> FloatArray:
        """(p, p) lower triangular: whitens the first p rows of a segment to variance σ²."""
        start = np.zeros((self.order, self.order))
        tail = np.cumprod((1.0 - self.reflections**2)[::-1])[::-1]
        for k in range(self.order):
            start[k, : k + 1] = np.sqrt(tail[k]) * self._predictors[k][::-1]
        return start

    def whiten(self, rows: FloatArray, segments: Sequence[slice]) -> FloatArray:
        """Apply Ĉ(z⁻¹) within each segment, without losing a row.

        The row at place k < p of a segment is predicted by the order-k predictor and scaled by
        σ/σ_k, so that every whitened row of the residual has the innovation variance.

        `rows` (r,) or (r, k): y, or columns of X or Z, of one joint. `segments`: rows that are
        contiguous in time. They must cover every row in order; rows of different segments are taken
        as independent. Returns ndarray of the shape of `rows`, in single precision where they are.
        """
        return self._filtered(rows, segments, 1.0, whiten_lines)

    def _filtered(
        self, rows: FloatArray, segments: Sequence[slice], scale: float, kernel: Callable[..., None]
    ) -> FloatArray:
        starts = _starts(segments, len(rows))
        precision = np.float32 if rows.dtype == np.float32 else np.float64
        if self.order == 0 or rows.size == 0:
            return np.asarray(scale * rows, dtype=precision)
        lines = np.ascontiguousarray(rows.reshape(len(rows), -1).T, dtype=precision)
        made = np.empty_like(lines)
        polynomial, start = self._predictors[-1].astype(precision), self._start.astype(precision)
        kernel(lines, starts, polynomial, start, precision(scale), made)
        return made.T.reshape(rows.shape)

    def shaping_adjoint(self, rows: FloatArray, positions: IntArray) -> FloatArray:
        """Apply the transposed shaping filter 1/C to rows zero-filled on their regular grid.

        With G the result, σ² GᵀG = rowsᵀ R rows exactly, where R is the covariance that the model
        gives the residual at the rows' places: what the covariance of an estimate needs that did
        not filter its rows. Dropped rows stay zero: the residual is there, only nobody weighs it.

        `rows` (r, k): columns of Z of one joint, unfiltered. `positions` (r,) increasing int: place
        of each row on the regular grid; those further apart than the memory of the filter, as
        recordings are, count as independent. Returns (g, k), g ≥ r: one row for each filled place.
        """
        if len(rows) == 0 or self.order == 0:
            return np.array(rows, dtype=float)
        if np.any(np.diff(positions) <= 0):
            raise ValueError("positions must increase")
        cuts = np.flatnonzero(np.diff(positions) > self._memory) + 1
        pieces = []
        for piece in np.split(np.arange(len(rows)), cuts):
            place = positions[piece] - positions[piece[0]]
            grid = np.zeros((int(place[-1]) + 1, rows.shape[1]))
            grid[place] = rows[piece]
            pieces.append(self._adjoint_of_segment(grid))
        return np.vstack(pieces)

    def _adjoint_of_segment(self, grid: FloatArray) -> FloatArray:
        """Solve Lᵀ u = grid, L being the whitening of one segment with its exact start."""
        count = min(self.order, len(grid))
        start = self._start[:count, :count]
        if len(grid) <= self.order:
            return np.asarray(scipy.linalg.solve_triangular(start, grid, lower=True, trans="T"))
        body, state = scipy.signal.lfilter(
            [1.0],
            self._predictors[-1],
            grid[count:][::-1],
            axis=0,
            zi=np.zeros((self.order, grid.shape[1])),
        )
        head = grid[:count] + state[:count][::-1]
        head = scipy.linalg.solve_triangular(start, head, lower=True, trans="T")
        return np.vstack([head, body[::-1]])

    @cached_property
    def _memory(self) -> int:
        """Lag after which the impulse response of 1/C stays below 1e-3 of its peak."""
        impulse = np.zeros(_MEMORY_LIMIT)
        impulse[0] = 1.0
        response = np.abs(scipy.signal.lfilter([1.0], self._predictors[-1], impulse))
        return int(np.flatnonzero(response > 1e-3 * response.max())[-1]) + 1


def _longer(polynomial: FloatArray, reflection: float) -> FloatArray:
    """One step of the Levinson recursion: the polynomial (k + 1,) of the next order."""
    longer = np.append(polynomial, 0.0)
    return longer + reflection * longer[::-1]


def fit_autoregression(
    residual: FloatArray, segments: Sequence[slice], *, max_order: int | None = None
) -> AutoregressiveModel:
    """Fit an autoregressive model by Burg's recursion over all segments, its order by AIC.

    Each κ_k minimises the forward and backward prediction errors summed over the segments longer
    than k, so no prediction reaches across a gap and the model is always stable. With n_k
    rows that have k predecessors in their segment, minus twice the Gaussian log-likelihood with
    the exact start of every segment is r ln σ₀² + Σ_k n_k ln(1 − κ_k²); AIC adds 2 for each
    coefficient. The mean is not removed: an offset belongs to the model of the joint.

    `residual`: (r,) or (r, m), residual of one joint, y − X β̂; the energies of several columns are
    summed. `segments`: rows that are contiguous in time. `max_order`: highest order tried; by
    default 100 or, if that is lower, the order at which ten rows with a full past are left for each
    coefficient.
    """
    residual = np.asarray(residual, dtype=float)
    place = _place_in_segment(segments, len(residual))
    # n_k for k = 0 … : how many rows have at least k predecessors in their segment.
    with_past = np.cumsum(np.bincount(place, minlength=1)[::-1])[::-1]
    if max_order is None:
        enough = with_past[1:] >= _ROWS_PER_COEFFICIENT * np.arange(1, len(with_past))
        max_order = min(_LARGEST_ORDER, int(np.count_nonzero(enough)))
    power = float(np.vdot(residual, residual)) / max(1, len(residual))
    if power == 0.0:
        return AutoregressiveModel(np.zeros(0), 0.0)
    reflections = burg_reflections(residual, segments, min(max_order, len(with_past) - 1))
    gain = np.log1p(-(reflections**2))
    orders = np.arange(1, len(reflections) + 1)
    criterion = np.append(0.0, np.cumsum(with_past[orders] * gain + 2.0))
    chosen = reflections[: int(np.argmin(criterion))]
    return AutoregressiveModel(chosen, power * float(np.prod(1.0 - chosen**2)))


def burg_reflections(series: FloatArray, segments: Sequence[slice], order: int) -> FloatArray:
    """Reflection coefficients κ₁ … of Burg's recursion over all segments.

    `series`: (r,) or (r, m), several columns are realisations of one process: their energies are
    summed. `segments`: rows that are contiguous in time. `order`: how many are wanted; fewer are
    returned when nothing is left to predict.
    """
    series = series.reshape(len(series), -1)
    reflections = np.empty(order)
    reached = burg(
        np.array(series, order="C"),
        np.array(series, order="C"),
        _place_in_segment(segments, len(series)),
        np.finfo(float).eps * float(np.vdot(series, series)),
        # |κ| ≤ 1 by Cauchy-Schwarz; rounding must not make it 1, which has no variance left.
        _UNITY,
        reflections,
    )
    return reflections[:reached]


def _place_in_segment(segments: Sequence[slice], n_rows: int) -> IntArray:
    """Number (r,) of predecessors that a row has in its segment, of all rows."""
    starts = _starts(segments, n_rows)
    return np.arange(n_rows) - np.repeat(starts[:-1], np.diff(starts))


def _starts(segments: Sequence[slice], n_rows: int) -> IntArray:
    """First rows of all segments, and at the end the number of rows (m + 1,).

    Runs that overlap or leave rows out would silently mix or lose rows.
    """
    starts = segments.starts if isinstance(segments, Segments) else Segments(segments).starts
    if starts[-1] != n_rows:
        raise ValueError(f"segments cover {starts[-1]} rows of {n_rows}")
    return starts


@entry
def whiten_lines(
    lines: FloatArray,
    starts: IntArray,
    polynomial: FloatArray,
    start: FloatArray,
    scale: float,
    whitened: FloatArray,
) -> None:
    """Apply a prediction-error filter within each segment, compiled.

    `lines`: (k, r), one column of rows a line. `starts`: (m + 1,) int, first row of each segment,
    and the number of rows. `polynomial`: (p + 1,), 1, c₁ … c_p. `start`: (p, p) lower triangular,
    whitens the first p rows of a segment.
    """
    order = len(polynomial) - 1
    for k in range(len(lines)):
        line, made = lines[k], whitened[k]
        for t in range(len(line)):
            made[t] = scale * line[t]
        for lag in range(1, order + 1):
            weight = scale * polynomial[lag]
            past, now = line[: len(line) - lag], made[lag:]
            for t in range(len(now)):
                now[t] += weight * past[t]
        for m in range(len(starts) - 1):
            first = starts[m]
            for row in range(min(order, starts[m + 1] - first)):
                total = 0.0
                for column in range(row + 1):
                    total += start[row, column] * line[first + column]
                made[first + row] = scale * total


@entry
def whiten_lines_adjoint(
    lines: FloatArray,
    starts: IntArray,
    polynomial: FloatArray,
    start: FloatArray,
    scale: float,
    drawn: FloatArray,
) -> None:
    """Apply the transpose of the filter of `whiten_lines` to lines; arguments as there."""
    order = len(polynomial) - 1
    for k in range(len(lines)):
        line, made = lines[k], drawn[k]
        made[:] = 0.0
        for m in range(len(starts) - 1):
            first, end = starts[m], starts[m + 1]
            head = min(first + order, end)
            for lag in range(order + 1):
                weight = scale * polynomial[lag]
                for t in range(head, end):
                    made[t - lag] += weight * line[t]
            for row in range(head - first):
                weight = scale * line[first + row]
                for column in range(row + 1):
                    made[first + column] += weight * start[row, column]


@entry
def burg(
    forward: FloatArray,
    backward: FloatArray,
    place: IntArray,
    floor: float,
    most: float,
    reflections: FloatArray,
) -> int:
    """Write reflection coefficients and return how many there are.

    `forward`, `backward`: (r, m), the series, twice; overwritten by its prediction errors. `place`:
    (r,) int, how many predecessors each row has in its segment. `floor`: energy below which nothing
    is left to predict. `most`: modulus of a reflection coefficient, at most.
    """
    for step in range(1, len(reflections) + 1):
        energy, product = 0.0, 0.0
        for t in range(1, len(place)):
            if place[t] >= step:
                for m in range(forward.shape[1]):
                    ahead, behind = forward[t, m], backward[t - 1, m]
                    energy += ahead * ahead + behind * behind
                    product += ahead * behind
        if energy <= floor:
            return step - 1
        reflection = min(max(-2.0 * product / energy, -most), most)
        reflections[step - 1] = reflection
        for t in range(len(place) - 1, 0, -1):
            if place[t] >= step:
                for m in range(forward.shape[1]):
                    ahead, behind = forward[t, m], backward[t - 1, m]
                    forward[t, m] = ahead + reflection * behind
                    backward[t, m] = behind + reflection * ahead
    return len(reflections)
