"""Prediction of a running robot's efforts from the samples that have arrived.

Positions pass through the filter of the identification, forward and backward, over a sliding
window; a sample waits (`lag`) until the later ones that its filter needs have come. Two outputs:

- **curves**, as early as possible: efforts measured and predicted, smoothed without phase;
- **rows**, about a second later: the residual through the parallel decimation of the
  identification, on samples that count there too. Only these are compared with its noise floor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from idim_iv_ros.prediction.identified_model import IdentifiedModel, ResidualRows
from idim_iv_ros.recording.grid import Grid, make_grid, on_grid
from idim_iv_ros.recording.wraps import TURN
from idim_iv_ros.signals.decimation import ParallelDecimation
from idim_iv_ros.signals.filters import butterworth_samples, zero_phase_butterworth
from idim_iv_ros.signals.joint_side import JointSignals
from idim_iv_ros.signals.motion import REVERSAL_MARGIN, Motion, decimated_motion, fast_samples
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_SECOND = 1e9
NEVER = np.iinfo(np.int64).min
_LONGEST_PAUSE = 1.0  # s
_MOST = 5_000_000_000  # ns of samples that are kept at most
# A stamp further back than so many intervals, s at least: the clock was set back.
_SET_BACK, _SET_BACK_INTERVALS = 0.1, 20.0
_WRAP = 0.75 * TURN  # a longer step between two positions is a wrap
# Time and samples at least, from which a rate is measured.
_LEAST, _LEAST_SAMPLES = 0.5, 20
# Steps whose median tells whether the rate has changed, and by how much, as a ratio.
_RECENT, _OTHER_RATE = 60, 1.3


@dataclass(frozen=True)
class JointSamples:
    """Stamped values of all joints."""

    time: IntArray  # (n,) int: ns
    values: FloatArray  # (n, n_joints): NaN where a joint has none
    # (n, n_joints): joints that each sample is about; None where every sample is about all of them
    named: BoolArray | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def about(self) -> BoolArray:
        """Return the joints that each sample has values of, (n, n_joints) bool."""
        return np.ones(self.values.shape, dtype=bool) if self.named is None else self.named

    @property
    def newest(self) -> IntArray:
        """Return the newest stamp of each joint, (n_joints,) ns; `NEVER` without one."""
        stamps = np.where(self.about, self.time[:, None], NEVER)
        return np.asarray(stamps.max(axis=0, initial=NEVER))

    @property
    def slowest(self) -> IntArray:
        """Return the stamps, ns, of the joint with the fewest samples."""
        counts = self.about.sum(axis=0)
        column = int(np.argmin(np.where(counts > 0, counts, len(self) + 1)))
        return np.asarray(self.time[self.about[:, column]])

    def followed_by(self, later: "JointSamples") -> "JointSamples":
        """Return these and later samples in the order of time; equal stamps are merged."""
        times, place = np.unique(np.concatenate([self.time, later.time]), return_inverse=True)
        row, column = np.nonzero(np.concatenate([self.about, later.about]))
        values = np.concatenate([self.values, later.values])
        merged = np.full((len(times), values.shape[1]), np.nan)
        named = np.zeros(merged.shape, dtype=bool)
        merged[place[row], column], named[place[row], column] = values[row, column], True
        return JointSamples(times, merged, named)

    def part(self, rows: slice) -> "JointSamples":
        """Return a slice of the samples."""
        return JointSamples(self.time[rows], self.values[rows], self.about[rows])


class SampleStream:
    """The newest samples of one topic, whose quantity is `name`: ``position`` or ``effort``.

    `turning` (n_joints,) are positions that may wrap after one turn.
    """

    def __init__(self, name: str, turning: Sequence[bool]) -> None:
        self.name, self._turning = name, np.array(turning, dtype=bool)
        self.samples = JointSamples(np.zeros(0, np.int64), np.zeros((0, len(turning))))
        self.restarted = ""  # why the last `add` dropped older samples: a pause, a clock
        self.late = 0  # samples left out because their stamps do not increase
        self.arrived = 0  # time of the last change of `reached`, ns
        self.rate: float | None = None  # of sampling, Hz; None until `measure_rate`

    def add(self, new: JointSamples, now: int) -> None:
        """Append samples in the order of their arrival, at time `now`, ns."""
        self.restarted = ""
        if len(new) == 0:
            return
        time, first, before = np.append(self.samples.time[-1:], new.time), 0, self.reached
        steps = np.diff(time) / _SECOND
        back = -max(_SET_BACK, _SET_BACK_INTERVALS * (self.interval or 0.0))
        breaks = np.flatnonzero((steps < back) | (steps > _LONGEST_PAUSE))
        if len(breaks):
            # The last of them counts: what comes after it is one stretch.
            step = float(steps[breaks[-1]])
            jump = f"the stamps jump back by {-step:.3g} s"
            self.restarted = jump if step < 0.0 else f"no sample for {step:.3g} s"
            first = len(new) - (len(time) - 1 - int(breaks[-1]))
            self.clear()
        self._append(new.part(slice(first, None)))
        if self.reached != before:
            self.arrived = now
        self.forget(int(self.samples.time[-1]) - _MOST)

    def _append(self, new: JointSamples) -> None:
        stamps = np.vstack([self.samples.newest, np.where(new.about, new.time[:, None], NEVER)])
        about = new.about & (new.time[:, None] > np.maximum.accumulate(stamps)[:-1])
        fresh = about.any(axis=1)
        self.late += int(np.count_nonzero(~fresh))
        values = np.where(about, new.values, np.nan)[fresh]
        self.samples = self.samples.followed_by(JointSamples(new.time[fresh], values, about[fresh]))
        positions = self.samples.values
        for joint in np.flatnonzero(self._turning):
            measured = np.isfinite(positions[:, joint])
            positions[measured, joint] = np.unwrap(positions[measured, joint], discont=_WRAP)

    def forget(self, before: int) -> None:
        """Drop samples stamped before a time, ns, except the last one."""
        first = min(int(np.searchsorted(self.samples.time, before)), max(len(self.samples) - 1, 0))
        self.samples = self.samples.part(slice(first, None))

    def clear(self) -> None:
        """Drop all samples."""
        self.samples = self.samples.part(slice(0))

    @property
    def interval(self) -> float | None:
        """Return the median of the recent sampling intervals, s; None below two samples."""
        recent = self.samples.slowest[-_RECENT:]
        return float(np.median(np.diff(recent))) / _SECOND if len(recent) > 1 else None

    @property
    def reached(self) -> int:
        """Return the stamp up to which all joints have samples, ns; `NEVER` without any."""
        newest = self.samples.newest
        return int(np.min(newest, where=newest > NEVER, initial=np.max(newest, initial=NEVER)))

    def measure_rate(self) -> float | None:
        """Return the rate of all samples, Hz, as for a recording; None while they are few."""
        time = self.samples.slowest
        enough = len(time) >= _LEAST_SAMPLES and time[-1] - time[0] >= _LEAST * _SECOND
        self.rate = make_grid(time, int(time[0]), int(time[-1])).rate if enough else None
        return self.rate

    @property
    def other_rate(self) -> float | None:
        """Return the rate of the recent samples, Hz, if it has changed; else None."""
        interval = self.interval
        if len(self.samples.slowest) < _RECENT or interval is None or self.rate is None:
            return None
        return None if 1.0 / _OTHER_RATE < interval * self.rate < _OTHER_RATE else 1.0 / interval

    @property
    def missing(self) -> BoolArray:
        """Return the joints (n_joints,) bool without a finite value in the samples kept."""
        return np.asarray(~np.isfinite(self.samples.values).any(axis=0))


CURVE_TOLERANCE = 0.01  # share of an impulse response that curves, and decimation, do not wait for
ROW_TOLERANCE = 1e-4  # the same of the positions behind the rows

_CURVE_LAG = 0.15  # s, which both filters of the curves share
_LEAST_SMOOTHING = 0.03  # s of it that is left to the efforts where the positions need more
_HIGHEST = 0.8  # of the Nyquist frequency: smoothing that smooths nothing
_EVERY = 0.2  # s between two looks for new rows
# s of samples before the window, by which splines and bridged gaps are what they are.
_CONTEXT = 0.24


class PredictionWindow:
    """Sliding window of the newest samples, k at start + k / rate: filter, predict and smooth.

    `rate` is that of the grid, Hz, `start` its first stamp, ns.
    """

    def __init__(self, identified: IdentifiedModel, rate: float, start: int) -> None:
        self.rate, self._start, self._identified = rate, start, identified
        made = identified.result.processing
        self._cutoff, self._order = made.position_cutoff, made.position_order
        self._wait = butterworth_samples(rate, self._cutoff, self._order, CURVE_TOLERANCE)
        self._settled = butterworth_samples(rate, self._cutoff, self._order, ROW_TOLERANCE)
        self._smoothing, self._smooth_wait = self._curve_filter(made.decimation_cutoff)
        self.lag = (self._wait + self._smooth_wait) / rate  # s from a sample to the curves
        # The decimation of the identification at this rate: the same edge in Hz.
        self._factor = max(1, round(rate / made.row_rate))
        self.row_rate = rate / self._factor  # Hz
        given = identified.processing
        edge = min(given.decimation_edge * made.row_rate / self.row_rate, 1.0)
        changes = {"decimation_edge": edge, "decimation_phase": "first"}
        self._processing = given.model_copy(update=changes)
        self._row_wait = ParallelDecimation(self._factor, 1, edge).settling(CURVE_TOLERANCE)
        margin = REVERSAL_MARGIN if given.reversal_margin is None else given.reversal_margin
        self._reach = max(self._factor, round(margin * self._factor))
        self._minimum_speed = np.array(made.minimum_speed)
        self._coupling_joints = identified.model.regressor.layout.coupling_joints
        self._end = 0  # number behind the newest sample
        self._next_row = 0

    def _curve_filter(self, wanted: float) -> tuple[float, int]:
        """Return cut-off, Hz, of the filter that smooths curves, and its delay in samples.

        The cut-off is `wanted`, or higher as far as the allowed lag requires.
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

    def _stamp(self, number: int) -> int:
        return self._start + round(number * 1e9 / self.rate)

    @property
    def needed(self) -> int:
        """Return the stamp of the oldest sample that is still needed, ns."""
        oldest = min(self._curve_start, self._next_row - self._row_wait - self._factor)
        return self._stamp(max(0, oldest - 3 * self._settled)) - round(1e9 * _CONTEXT)

    @property
    def missing(self) -> float:
        """Return the time until the first sample of the curves, s."""
        return max(0.0, (self._settled + self._smooth_wait - self._curve_place) / self.rate)

    @property
    def _curve_place(self) -> int:
        return self._end - 1 - self._wait - self._smooth_wait

    @property
    def _curve_start(self) -> int:
        return self._curve_place - max(3 * self._smooth_wait, self._reach)

    def advance(
        self, positions: JointSamples, efforts: JointSamples, until: int, rows: ResidualRows
    ) -> tuple[int, FloatArray, FloatArray] | None:
        """Process samples up to the stamp `until`, ns; add finished rows to `rows`.

        Returns stamp, ns, and smoothed efforts of the newest sample of the curves, measured and
        predicted, (n_joints,) N m (N); None while the filters fill.
        """
        self._end = int((until - self._start) * 1e-9 * self.rate + 0.01) + 1
        if self.missing > 0.0:
            return None
        oldest = max(positions.time[0], efforts.time[0]) - self._start
        available = max(0, int(np.ceil(oldest * 1e-9 * self.rate)))
        places = self._new_rows(available)
        first = max(self._curve_start, available)
        if len(places):
            # Begins at a decimated sample, as the identification does.
            first = min(first, int(places[0]) - self._row_wait)
            first = max(first // self._factor, -(-available // self._factor)) * self._factor
        motion = self._motion(positions, efforts, first, available)
        matrix = self._identified.model.matrix(*motion.derivatives(0, self._end - first))
        predicted = matrix @ self._identified.values
        if len(places):
            row = (places - first) // self._factor
            of_rows = matrix[places - first]
            covariance = self._identified.result.covariance
            variance = np.einsum("sjb,sjb->sj", of_rows @ covariance, of_rows)
            residual = motion.decimation.at(motion.torque - predicted, places - first)
            rows.add(places=places, residual=residual, counts=motion.kept[row], variance=variance)
            self._next_row = int(places[-1]) + self._factor
        return self._curve(motion, predicted, first)

    def _new_rows(self, available: int) -> IntArray:
        """Return the sample numbers of rows that are now complete; empty until several are.

        After many samples at once, rows whose past was dropped are left out.
        """
        factor, wait = self._factor, self._settled + self._row_wait
        begin = max(self._next_row, -(-(available + wait) // factor) * factor)
        last = (self._end - 1 - wait) // factor * factor
        due = last - begin >= _EVERY * self.rate
        return np.arange(begin, last + 1, factor) if due else np.arange(0)

    def _motion(
        self, positions: JointSamples, efforts: JointSamples, first: int, available: int
    ) -> Motion:
        """Return the samples from number `first` on, filtered as in the identification."""
        transform = self._identified.transform
        begin = max(first - 3 * self._settled, available)
        grid = Grid(self._stamp(begin), self.rate, self._end - begin)
        position = on_grid(grid, positions.time, positions.values, "", smooth=True)
        effort = on_grid(grid, efforts.time, efforts.values, "")
        valid = ~transform.touched(position.invented, effort.invented)
        torque = transform.torque(effort.values)
        record = JointSignals("", self.rate, transform.position(position.values), torque, valid)
        smoothed = self._smooth(record.position, self._cutoff)
        span = slice(first - begin, grid.samples)
        settings = self._processing, (self._cutoff, self._factor), self._minimum_speed
        return decimated_motion(record, smoothed, span, *settings, self._coupling_joints)

    def _smooth(self, values: FloatArray, cutoff: float) -> FloatArray:
        return zero_phase_butterworth(values, rate=self.rate, cutoff=cutoff, order=self._order)

    def _curve(
        self, motion: Motion, predicted: FloatArray, first: int
    ) -> tuple[int, FloatArray, FloatArray]:
        """Return stamp, ns, measured and predicted efforts (n_joints,) at the curves' end."""
        place = self._curve_place - first
        begin = max(0, place - 3 * self._smooth_wait)
        smoothed = np.hstack([motion.torque, predicted])[begin : place + self._smooth_wait + 1]
        if self._smooth_wait:
            smoothed = self._smooth(smoothed, self._smoothing)
        measured, predicted = np.split(smoothed[place - begin], 2)
        around = slice(max(place - self._reach, 0), place + self._reach + 1)
        valid = motion.signals.valid[motion.span][around].all(axis=0)
        position, least = motion.position[motion.span], self._minimum_speed
        moves = fast_samples(position, self.rate, least, self._coupling_joints)[around].all(axis=0)
        measured = np.where(valid, measured, np.nan)
        return self._stamp(self._curve_place), measured, np.where(valid & moves, predicted, np.nan)


SHARE_SECONDS = 1.0  # of rows behind the share of the noise floor

_SILENT, _SILENT_INTERVALS = 0.5, 5.0  # s, sampling intervals
_LEAST_ROWS = 5  # that count, behind a share


@dataclass(frozen=True)
class Prediction:
    """One sample of the curves and noise shares, (n_joints,) N m (N); as message Prediction."""

    stamp: int  # of the predicted sample, else of the newest, ns; 0 without any
    reason: str  # why nothing is predicted; empty for a prediction
    measured: FloatArray
    predicted: FloatArray
    residual: FloatArray
    noise_share: FloatArray

    @classmethod
    def absent(cls, joints: int, reason: str, stamp: int = 0) -> "Prediction":
        """Return that nothing is predicted, and why; `stamp` is that of the newest sample, ns."""
        return cls(stamp, reason, *[np.full(joints, np.nan)] * 4)


class LivePrediction:
    """Predicts the newest sample that its filters reach, from samples as they arrive."""

    def __init__(self, identified: IdentifiedModel) -> None:
        self.identified, joints = identified, len(identified.joints)
        # Recorded positions of a joint that turns may wrap after one turn.
        plain = np.array_equal(identified.transform.to_joint, np.eye(joints))
        turning = [plain and kind == "revolute" for kind in identified.result.joint_types]
        self._positions = SampleStream("position", turning)
        self._efforts = SampleStream("effort", [False] * joints)
        self._streams = (self._positions, self._efforts)
        self.window: PredictionWindow | None = None  # while the rate is measured
        self._why = ""
        self.rows = ResidualRows(joints, 1.0)  # decimated residual, to judge its size by

    @property
    def late(self) -> int:
        """Return how many samples of a topic were left out: their stamps do not increase."""
        return max(stream.late for stream in self._streams)

    def add(self, positions: JointSamples, efforts: JointSamples, now: int) -> None:
        """Add samples, in the units of the topics, in the order of their arrival at `now`, ns."""
        for stream, new in zip(self._streams, (positions, efforts), strict=True):
            stream.add(new, now)
        if restarted := self._positions.restarted or self._efforts.restarted:
            self._restart(restarted)

    def _restart(self, why: str) -> None:
        self.window, self._why = None, f"{why}: filtering begins anew"
        for stream in self._streams:
            if not stream.restarted:
                stream.clear()

    def newest(self, now: int) -> Prediction:
        """Predict the newest sample that the filters reach; `now`, ns, is as in `add`."""
        reason = self._not_usable(now)
        if not reason and self.window is None:
            reason = self._measure_rate()
        window, curve = self.window, None
        times = self._positions.samples.time
        newest = int(times[-1]) if len(times) else 0
        if not reason and window is not None:
            until = min(stream.reached for stream in self._streams)
            curve = window.advance(self._positions.samples, self._efforts.samples, until, self.rows)
            for stream in self._streams:
                stream.forget(window.needed)
            why = f"{self._why}; " if self._why else ""
            reason = f"{why}the filters fill: {window.missing:.1f} s to go"
        if curve is None:
            return Prediction.absent(len(self.identified.joints), reason, newest)
        self._why = ""
        stamp, measured, predicted = curve
        floor = self.identified.noise_floor
        share = self.rows.share(SHARE_SECONDS, _LEAST_ROWS) / np.where(floor > 0.0, floor, np.nan)
        return Prediction(stamp, "", measured, predicted, measured - predicted, share)

    def _not_usable(self, now: int) -> str:
        """Return why the samples cannot be used; empty if they can."""
        for stream in self._streams:
            name, joints = stream.name, self.identified.joints
            if len(stream.samples) == 0:
                return f"no {name} has arrived"
            silent = (now - stream.arrived) * 1e-9
            if silent > max(_SILENT, _SILENT_INTERVALS * (stream.interval or 0.0)):
                return f"no {name} for {silent:.1f} s"
            missing = list(compress(joints, stream.missing))
            if missing and (name == "position" or len(missing) == len(joints)):
                return f"no {name} of {', '.join(missing)} in the messages"
            if self.window is not None and (new := stream.other_rate) is not None:
                rates = f"from {stream.rate:.4g} to {new:.4g} Hz"
                self._restart(f"the rate of the {name} changed {rates}")
                return self._why  # all samples were dropped: the rate must be measured again
        return ""

    def _measure_rate(self) -> str:
        rate, _ = rates = [stream.measure_rate() for stream in self._streams]
        if rate is None or None in rates:
            return self._why or "measuring the rate of the samples"
        cutoff = self.identified.result.processing.position_cutoff
        if cutoff >= rate / 2.0:
            return (
                f"positions come at {rate:.4g} Hz, and the result was made with a cut-off of "
                f"{cutoff:g} Hz: more than {2.0 * cutoff:g} Hz are needed"
            )
        start = max(int(stream.samples.time[0]) for stream in self._streams)
        self.window = PredictionWindow(self.identified, rate, start)
        self.rows = ResidualRows(len(self.identified.joints), self.window.row_rate)
        return ""
