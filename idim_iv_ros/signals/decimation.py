"""Parallel decimation: one low-pass filter for the torque and for every column of the regressor.

Source: paper, section II.C. The filter is a Chebyshev filter of type I, order 8, 0.05 dB ripple,
run forward and backward. MATLAB puts its edge at 0.8 of the new Nyquist frequency; the band
above is then empty, and a residual that was white is predictable from its past.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.compilation import entry, kernel
from idim_iv_ros.signals.filters import settling_samples
from idim_iv_ros.types import FloatArray, IntArray

_ORDER = 8
_RIPPLE = 0.05  # dB
# The impulse response has decayed to rounding after this many samples of the decimated series.
_MEMORY = 80
# What MATLAB pads: three times the order. Published results depend on it (EMPS, fourth digit).
_PADDING = 3 * _ORDER
# Rows whose rates differ by up to this share count as equally dense: a residual's autocorrelation,
# its bands of frequency and blocks of time are not resolved any finer. Bags of one rig differ by as
# much; each keeps its own stamps, filters and derivatives, and nothing is interpolated.
_SAME_RATE = 0.02
_LANES, _TILE = 32, 64  # signals that are filtered together, and samples of a tile
# Smallest state of a filter in double and in single precision.
_SMALLEST = {np.dtype(np.float64): 1e-200, np.dtype(np.float32): 1e-30}


@dataclass(frozen=True)
class Chunk:
    """Samples `first` to `last`, the end excluded, which decimated ones need."""

    first: int
    last: int
    kept: NDArray[np.int64]  # decimated samples, as indices in the full record
    places: slice  # of these among all decimated ones


@dataclass(frozen=True)
class ParallelDecimation:
    """Keep one sample in `factor` of a record of `samples`, after the low-pass filter."""

    factor: int  # 1 keeps everything and filters nothing
    samples: int
    edge: float  # of the filter, as a share of the new Nyquist frequency
    phase: Literal["first", "last"] = "first"  # sample that is kept of each group; MATLAB: the last

    @property
    def kept(self) -> NDArray[np.int64]:
        """Indices of the kept samples."""
        groups = -(-self.samples // self.factor)
        last = self.factor - (self.factor * groups - self.samples) - 1
        return np.arange(last if self.phase == "last" else 0, self.samples, self.factor)

    @cached_property
    def _sections(self) -> FloatArray:
        edge = self.edge / self.factor
        return np.asarray(scipy.signal.cheby1(_ORDER, _RIPPLE, edge, output="sos"))

    @cached_property
    def _constant_state(self) -> FloatArray:
        """(sections, 2) state of the filter in a signal that is 1 for ever."""
        return np.asarray(scipy.signal.sosfilt_zi(self._sections))

    def chunks(self, length: int) -> Iterator[Chunk]:
        """Split the record into chunks of about `length` samples that overlap by the memory.

        Filtering chunk by chunk then gives what filtering the whole record gives, to rounding.
        """
        kept = self.kept
        memory = _MEMORY * self.factor if self.factor > 1 else 2
        fits = self.samples <= length + memory
        groups = len(kept) if fits else max(1, length // self.factor)
        for start in range(0, len(kept), groups):
            inside = kept[start : start + groups]
            first = max(0, int(inside[0]) - memory)
            last = min(self.samples, int(inside[-1]) + 1 + memory)
            yield Chunk(first, last, inside, slice(start, start + groups))

    def apply(self, signal: FloatArray, chunk: Chunk) -> FloatArray:
        """Filter samples ``chunk.first … chunk.last`` along axis 0 and keep ``chunk.kept``.

        The result is that of `scipy.signal.sosfiltfilt` to the last bit; signals in single
        precision are filtered in it, in half of the time.
        """
        kept = chunk.kept - chunk.first
        if self.factor == 1:
            return np.asarray(signal[kept])
        lines = signal.reshape(len(signal), -1).T
        count = min(_PADDING, lines.shape[1] - 1)
        precision = lines.dtype if lines.dtype in _SMALLEST else np.dtype(np.float64)
        filtered = np.empty((len(lines), len(kept)), precision)
        _forward_backward(
            self._sections.astype(precision),
            self._constant_state.astype(precision),
            np.ascontiguousarray(lines, precision),
            count,
            kept,
            np.empty((lines.shape[1] + 2 * count, _LANES), precision),
            np.empty((_TILE, _LANES), precision),
            np.empty((2, len(self._sections), _LANES), precision),
            precision.type(_SMALLEST[precision]),
            filtered,
        )
        return filtered.T.reshape(len(kept), *signal.shape[1:])

    def at(self, signal: FloatArray, places: IntArray) -> FloatArray:
        """Filter a whole record (n_samples, …) and keep the samples at `places`, any of them."""
        return self.apply(signal, Chunk(0, self.samples, places, slice(None)))

    def settling(self, tolerance: float) -> int:
        """Samples that one waits for; see `settling_samples`."""
        return settling_samples(self._sections, tolerance) if self.factor > 1 else 0

    def whole(self, signal: FloatArray) -> FloatArray:
        """Decimate a whole record (n_samples, …) at once."""
        return self.at(signal, self.kept)


def decimation_factor(rate: float, cutoff: float, edge: float) -> int:
    """Largest factor that keeps `cutoff` (Hz) below the edge of the filter at `rate` (Hz)."""
    return max(1, int(edge * rate / (2.0 * cutoff) + 1e-9))


def common_factors(
    rates: Sequence[float], cutoff: float, edge: float
) -> tuple[tuple[int, ...], float] | None:
    """Decimation factors that bring several rates (Hz) to one, and this rate of the rows, Hz.

    The slowest recording is decimated as much as `cutoff` allows (`decimation_factor`), or less
    where the other rates are no multiples of what is left. All rates of rows agree within 2 %.
    None where no factors do that.
    """
    slowest = min(rates)
    for factor in range(decimation_factor(slowest, cutoff, edge), 0, -1):
        row_rate = slowest / factor
        factors = tuple(max(1, round(rate / row_rate)) for rate in rates)
        reached = [rate / factor for rate, factor in zip(rates, factors, strict=True)]
        if min(reached) >= (1.0 - _SAME_RATE - 1e-9) * max(reached):
            return factors, row_rate
    return None


@entry
def _forward_backward(
    sections: FloatArray,
    constant_state: FloatArray,
    lines: FloatArray,
    padding: int,
    kept: IntArray,
    work: FloatArray,
    tile: FloatArray,
    states: FloatArray,
    smallest: float,
    filtered: FloatArray,
) -> None:
    """Filter `lines` forward and backward and keep some samples, as `sosfiltfilt` with odd ends.

    Each step of a recursion waits for the one before: `_LANES` signals take it together, tile by
    tile, so that a tile stays in the cache. Operations and their order are those of `sosfilt`, so
    that every bit is the same down to numbers of 1e-200. Each end is extended by `padding` samples,
    point by point about it; `kept` (m,) increases; `work`, `tile` and `states` are overwritten;
    states below `smallest` are taken for zero.
    """
    lanes, size = tile.shape[1], tile.shape[0]
    count, samples = lines.shape
    length = samples + 2 * padding
    last = samples - 1
    for first in range(0, count, lanes):
        used = min(lanes, count - first)
        for lane in range(used, lanes):
            for t in range(size):
                tile[t, lane] = 0.0
        for start in range(0, length, size):
            steps = min(size, length - start)
            for lane in range(used):
                line = lines[first + lane]
                for t in range(steps):
                    place = start + t - padding
                    if place < 0:
                        tile[t, lane] = 2.0 * line[0] - line[-place]
                    elif place > last:
                        tile[t, lane] = 2.0 * line[last] - line[2 * last - place]
                    else:
                        tile[t, lane] = line[place]
            if start == 0:
                _settle(constant_state, tile[0], states)
            _advance(sections, states, tile, steps, smallest)
            for t in range(steps):
                for lane in range(lanes):
                    work[start + t, lane] = tile[t, lane]
        wanted = len(kept) - 1
        for end in range(length, 0, -size):
            steps = min(size, end)
            for t in range(steps):
                for lane in range(lanes):
                    tile[t, lane] = work[end - 1 - t, lane]
            if end == length:
                _settle(constant_state, tile[0], states)
            _advance(sections, states, tile, steps, smallest)
            while wanted >= 0 and kept[wanted] + padding >= end - steps:
                t = end - 1 - padding - kept[wanted]
                for lane in range(used):
                    filtered[first + lane, wanted] = tile[t, lane]
                wanted -= 1


@kernel
def _settle(constant_state: FloatArray, values: FloatArray, states: FloatArray) -> None:
    """Start as if the signals had always had these values."""
    for section in range(len(constant_state)):
        for lane in range(len(values)):
            states[0, section, lane] = constant_state[section, 0] * values[lane]
            states[1, section, lane] = constant_state[section, 1] * values[lane]


@kernel
def _advance(
    sections: FloatArray, states: FloatArray, tile: FloatArray, steps: int, smallest: float
) -> None:
    """Filter the first `steps` rows of the tile in place, section by section."""
    for section in range(len(sections)):
        b0, b1, b2 = sections[section, 0], sections[section, 1], sections[section, 2]
        a1, a2 = sections[section, 4], sections[section, 5]
        near, far = states[0, section], states[1, section]
        for t in range(steps):
            row = tile[t]
            for lane in range(_LANES):
                given = row[lane]
                made = b0 * given + near[lane]
                near[lane] = b1 * given - a1 * made + far[lane]
                far[lane] = b2 * given - a2 * made
                row[lane] = made
        for lane in range(_LANES):
            # After a signal has become zero its response decays to numbers so small that the
            # processor takes a hundred times as long for each.
            if abs(near[lane]) < smallest:
                near[lane] = 0.0
            if abs(far[lane]) < smallest:
                far[lane] = 0.0
