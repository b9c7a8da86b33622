"""The window of samples that slides: positions filtered, efforts predicted, residual decimated."""

import numpy as np

from idim_iv_ros.prediction.grid import LiveGrid
from idim_iv_ros.prediction.identified_model import IdentifiedModel
from idim_iv_ros.prediction.rows import ResidualRows
from idim_iv_ros.prediction.stream import JointSamples
from idim_iv_ros.signals import (
    REVERSAL_MARGIN,
    ParallelDecimation,
    butterworth_samples,
    central_differences,
    difference_order,
    fast_samples,
    zero_phase_butterworth,
)
from idim_iv_ros.signals.motion import all_around
from idim_iv_ros.types import BoolArray, FloatArray

CURVE_TOLERANCE = 0.01  # share of an impulse response that curves, and decimation, do not wait for
ROW_TOLERANCE = 1e-4  # the same of the positions behind the rows

_CURVE_LAG = 0.15  # s, which both filters of the curves share
_LEAST_SMOOTHING = 0.03  # s of it that is left to the efforts where the positions need more
_HIGHEST = 0.8  # of the Nyquist frequency: smoothing that smooths nothing
_EVERY = 0.2  # s between two looks for new rows


class PredictionWindow:
    """What is filtered, predicted and smoothed of the newest samples, and how far.

    Parameters
    ----------
    identified : IdentifiedModel
    rate : float
        Of the grid, Hz.
    start : int
        Its first stamp, ns.

    Attributes
    ----------
    lag : float
        From a sample until its place on the curves, s.
    row_rate : float
        Decimated samples per second, Hz.
    """

    def __init__(
        self,
        identified: IdentifiedModel,
        rate: float,
        start: int,
    ) -> None:
        self.rate = rate
        self._identified = identified
        processing = identified.result.processing
        self._cutoff, self._order = processing.position_cutoff, processing.position_order
        wait = butterworth_samples(rate, self._cutoff, self._order, CURVE_TOLERANCE)
        settled = butterworth_samples(rate, self._cutoff, self._order, ROW_TOLERANCE)
        self._wait, self._settled = wait, settled
        self._smoothing, self._smooth_wait = self._curve_filter(processing.decimation_cutoff)
        self._decimation = self._row_filter()
        self._row_wait = self._decimation.settling(CURVE_TOLERANCE)
        margin = identified.result.configuration.get("processing")
        given = margin.get("reversal_margin") if isinstance(margin, dict) else None
        factor = self._decimation.factor
        self._around = round((REVERSAL_MARGIN if given is None else float(str(given))) * factor)
        self.row_rate = rate / factor
        self.lag = (self._wait + self._smooth_wait) / rate
        joints = len(identified.joints)
        self._grid = LiveGrid(rate, start, joints)
        self._predicted = np.zeros((0, joints))
        self._fast: BoolArray = np.zeros((0, joints), dtype=bool)
        self._variance: dict[int, FloatArray] = {}  # of the predictions at the next rows
        self._end = 0  # number behind the last prediction
        self._done = 0  # samples whose prediction will not change
        self._first_row = -(-(settled + self._row_wait) // factor) * factor
        self._next_row = self._first_row
        # Long enough for both filters of the next row, and for the start of that of the positions.
        self._kept = 2 * self._row_wait + 3 * settled + round(2 * _EVERY * rate) + factor
        self._kept = max(self._kept, self._wait + 4 * self._smooth_wait)

    def _curve_filter(self, wanted: float) -> tuple[float, int]:
        """Cut-off, Hz, and samples to wait for of what smooths the curves.

        The cut-off is that of the rows, or so much higher that a sample waits no longer than it
        may.
        """
        rate = self.rate
        allowed = max(_CURVE_LAG - self._wait / rate, _LEAST_SMOOTHING) * rate
        cutoff = wanted
        while cutoff < _HIGHEST * rate / 2.0:
            samples = butterworth_samples(rate, cutoff, self._order, CURVE_TOLERANCE)
            if samples <= allowed:
                return cutoff, samples
            cutoff *= max(1.02, 0.98 * samples / allowed)
        return 0.0, 0

    def _row_filter(self) -> ParallelDecimation:
        """Return the decimation of the identification at this rate: the same edge in Hz."""
        result = self._identified.result
        row_rate = result.processing.row_rate
        factor = max(1, round(self.rate / row_rate))
        section = result.configuration.get("processing")
        edge = (
            float(str(section.get("decimation_edge", 0.95))) if isinstance(section, dict) else 0.95
        )
        scaled = min(edge * row_rate * factor / self.rate, 1.0)
        return ParallelDecimation(factor, 1, scaled)

    @property
    def needed(self) -> int:
        """Stamp of the oldest sample that is still needed, ns."""
        return self._grid.needed

    @property
    def missing(self) -> float:
        """Time until the first sample of the curves, s."""
        first = self._settled + self._smooth_wait
        return max(0.0, (first - self._curve_place) / self.rate)

    @property
    def _curve_place(self) -> int:
        return self._grid.end - 1 - self._wait - self._smooth_wait

    def advance(self, positions: JointSamples, efforts: JointSamples, end: int) -> None:
        """Take what has arrived up to a stamp, ns, and predict everything that is not settled."""
        grid, joint_side = self._grid, self._identified.transform
        grid.advance(positions, efforts, end, joint_side)
        if grid.end <= self._settled:
            return
        begin = max(self._done - 3 * self._settled, grid.first)
        record = grid.position[begin - grid.first :]
        filtered = zero_phase_butterworth(
            record, rate=self.rate, cutoff=self._cutoff, order=self._order
        )
        fresh = max(self._done, grid.first)
        place = fresh - begin
        velocity, acceleration = central_differences(
            filtered,
            rate=self.rate,
            start=place,
            order=difference_order(self._cutoff, self.rate),
        )
        identified = self._identified
        matrix = identified.model.matrix(filtered[place:], velocity, acceleration)
        predicted = matrix @ identified.values
        fast = fast_samples(filtered, self.rate, identified.minimum_speed, identified.couplings)[
            place:
        ]
        kept = len(self._predicted) - (self._end - fresh)
        self._predicted = np.concatenate([self._predicted[:kept], predicted])
        self._fast = np.concatenate([self._fast[:kept], fast])
        self._end = grid.end
        done = max(self._done, grid.end - self._settled)
        factor = self._decimation.factor
        settled = np.arange(-(-fresh // factor) * factor, done, factor)
        variance = identified.variance(matrix[settled - fresh])
        self._variance.update(zip(settled.tolist(), variance, strict=True))
        self._done = done
        self._trim()

    def _trim(self) -> None:
        surplus = len(self._predicted) - self._kept
        if surplus > 0:
            self._predicted, self._fast = self._predicted[surplus:], self._fast[surplus:]
        self._grid.forget(self._end - len(self._predicted))

    def curve(self) -> tuple[int, FloatArray, FloatArray]:
        """Stamp (ns) of the newest sample of the curves, its effort measured and predicted."""
        place, first = self._curve_place, self._grid.first
        begin = max(first, place - 3 * self._smooth_wait)
        stop = place + self._smooth_wait + 1
        inside = slice(begin - first, stop - first)
        both = np.hstack([self._grid.torque[inside], self._predicted[inside]])
        if self._smooth_wait:
            both = zero_phase_butterworth(
                both, rate=self.rate, cutoff=self._smoothing, order=self._order
            )
        measured, predicted = np.split(both[place - begin], 2)
        factor = self._decimation.factor
        around = slice(
            max(place - max(factor, self._around), first) - first,
            place + max(factor, self._around) + 1 - first,
        )
        there = self._grid.valid[around].all(axis=0)
        moves = self._fast[around].all(axis=0)
        measured = np.where(there, measured, np.nan)
        return (
            self._grid.stamp(place),
            measured,
            np.where(there & moves, predicted, np.nan),
        )

    def look_for_rows(self, rows: ResidualRows) -> bool:
        """Add the rows that both filters reach by now, a few at a time."""
        factor, wait = self._decimation.factor, self._row_wait
        last = ((self._done - 1 - wait) // factor) * factor
        first, grid = self._grid.first, self._grid
        # Where much arrives at once, rows are left out whose past is not there any more.
        reached = -(-(first + min(wait, self._first_row)) // factor) * factor
        begin_row = max(self._next_row, reached if first else 0)
        if last - begin_row < _EVERY * self.rate:
            return False
        places = np.arange(begin_row, last + 1, factor)
        begin = max(begin_row - wait, first)
        stop = min(last + wait + 1, grid.end)
        inside = slice(begin - first, stop - first)
        residual = grid.torque[inside] - self._predicted[inside]
        decimation = ParallelDecimation(factor, len(residual), self._decimation.edge)
        filtered = decimation.at(residual, places - begin)
        every = ParallelDecimation(1, len(residual), 1.0)
        counts = all_around(self._fast[inside], every, self._around)
        counts &= all_around(grid.valid[inside], every, factor)
        variance = np.array([self._variance[place] for place in places.tolist()])
        rows.add(places, filtered, counts[places - begin], variance)
        self._next_row = last + factor
        self._variance = {
            place: each for place, each in self._variance.items() if place >= self._next_row
        }
        return True
