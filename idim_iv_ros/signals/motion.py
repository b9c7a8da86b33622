"""Filtered motion with the torque that goes with it, ready for a regression."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from idim_iv_ros.configuration import ProcessingSection
from idim_iv_ros.errors import DataError
from idim_iv_ros.signals.cutoffs import Cutoffs
from idim_iv_ros.signals.decimation import ParallelDecimation
from idim_iv_ros.signals.filters import central_differences, zero_phase_butterworth
from idim_iv_ros.signals.joint_side import JointSignals
from idim_iv_ros.types import BoolArray, FloatArray

_SPEED_SHARE = 0.01  # of the peak speed: reversal regime when the user names none
_EDGE_PERIODS = 2.0  # of the position cut-off, cut at each end when the user names no trim
_EDGE_GROUPS = 2  # decimated samples cut at each end, likewise
# Decimated samples dropped on either side of a slow one when the user names no margin.
REVERSAL_MARGIN = 1.0
# Cut-off of the positions, as a share of the rate, up to which differences over three samples do:
# published figures are theirs. Above it an acceleration in the band would lose a tenth.
_THREE_SAMPLES = 0.15
# A joint whose motion is not this many times its noise, or its range below this or so many steps of
# its encoder, stands still.
_STILL_NOISE = 10.0
_STILL_RANGE = 1e-4
_STILL_STEPS = 2.5
_SEGMENT = 2.0  # s, of a spectrum of the torque
_NOISE_BAND = 3.0  # times the decimation cut-off, where only noise is left


@dataclass(frozen=True)
class Motion:
    """A recording whose positions are filtered and whose ends are trimmed."""

    signals: JointSignals
    cutoff: float  # of the position filter, Hz
    order: int  # of one pass of the position filter
    position: FloatArray  # (n_samples, n_joints), zero-phase filtered, rad or m, not trimmed
    span: slice  # the trimmed part; everything below refers to it
    decimation: ParallelDecimation
    # (n_kept, n_joints), decimated samples that count: measured, faster than the reversal speed.
    kept: BoolArray
    dropped: dict[str, int]

    def derivatives(self, first: int, last: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """States q, dq, ddq, (last - first, n_joints), of samples `first` … `last` of the span."""
        return self.derivatives_of(self.position, first, last)

    def derivatives_of(
        self, position: FloatArray, first: int, last: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return `derivatives` of other positions (n_samples, n_joints) of the whole record."""
        start = self.span.start
        rate = self.signals.rate
        velocity, acceleration = central_differences(
            position,
            rate=rate,
            start=start + first,
            stop=start + last,
            order=difference_order(self.cutoff, rate),
        )
        return position[start + first : start + last], velocity, acceleration

    def filtered(self, position: FloatArray) -> FloatArray:
        """Another position record (n_samples, n_joints) through the same filter."""
        return zero_phase_butterworth(
            position, rate=self.signals.rate, cutoff=self.cutoff, order=self.order
        )

    @property
    def torque(self) -> FloatArray:
        """Measured torque of the span, (n_samples, n_joints) N m."""
        return np.asarray(self.signals.torque[self.span])

    @property
    def time(self) -> FloatArray:
        """Time of the decimated samples from the start of the recording, (n_kept,) s."""
        return np.asarray((self.span.start + self.decimation.kept) / self.signals.rate)


def difference_order(cutoff: float, rate: float) -> Literal[2, 4]:
    """Order of the differences of positions that were filtered at `cutoff` (Hz)."""
    return 2 if cutoff <= _THREE_SAMPLES * rate else 4


def filter_motion(
    signals: Sequence[JointSignals],
    processing: ProcessingSection,
    cutoffs: Cutoffs,
    joints: Sequence[str],
    couplings: Sequence[tuple[int, int]] = (),
) -> tuple[tuple[Motion, ...], FloatArray, tuple[str, ...], tuple[str, ...]]:
    """Filter the positions of all recordings and decide which decimated samples count.

    Returns the motion of each recording, the reversal speed (n_joints,) rad/s, joints that stand
    still in all recordings, and sentences for the report.

    Raises DataError: a recording is too short to be filtered, or no joint ever moves.
    """
    filtered = []
    still = np.ones(len(joints), dtype=bool)
    for record in signals:
        try:
            position = zero_phase_butterworth(
                record.position,
                rate=record.rate,
                cutoff=cutoffs.position,
                order=processing.position_order,
            )
        except ValueError as error:
            raise DataError(f"{record.name}: {error}; record for longer") from error
        filtered.append(position)
        still &= _stands_still(record.position, position)
    if still.all():
        ranges = np.array([np.ptp(record.position, axis=0) for record in signals])
        place, joint = divmod(int(np.argmax(ranges)), ranges.shape[1])
        noise = float(np.std((signals[place].position - filtered[place])[:, joint]))
        raise DataError(
            f"{', '.join(record.name for record in signals)}: no joint moves: the most is "
            f"{joints[joint]} over {ranges[place, joint]:.2g} (rad, or m), with noise of "
            f"{noise:.2g} (σ); record an exciting motion"
        )
    spans = [
        _span(record, processing, cutoffs.position, factor)
        for record, factor in zip(signals, cutoffs.factors, strict=True)
    ]
    for position in filtered:
        position[:, still] = position[:, still].mean(axis=0)
    peaks = np.zeros(len(joints))
    for record, position, span in zip(signals, filtered, spans, strict=True):
        speeds = (np.gradient(joint, 1.0 / record.rate) for joint in position[span].T)
        peaks = np.maximum(peaks, [np.abs(speed).max() for speed in speeds])
    at_rest = tuple(name for name, rests in zip(joints, still, strict=True) if rests)
    reasons = []
    if at_rest:
        reasons.append(f"{', '.join(at_rest)} stands still: its noise is not taken for motion")
    minimum_speed = np.array(processing.minimum_speed)
    if processing.minimum_speed is None:
        minimum_speed = _SPEED_SHARE * peaks
        reasons.append(
            f"samples slower than {100 * _SPEED_SHARE:g} % of a joint's peak speed are kept out of "
            "its rows: the sign of the speed is not known there"
        )
    parts = zip(signals, filtered, spans, cutoffs.factors, strict=True)
    motions = tuple(
        decimated_motion(
            record, position, span, processing, (cutoffs.position, factor), minimum_speed, couplings
        )
        for record, position, span, factor in parts
    )
    return motions, minimum_speed, at_rest, tuple(reasons)


def _stands_still(raw: FloatArray, filtered: FloatArray) -> BoolArray:
    still = []
    for recorded, smooth in zip(raw.T, filtered.T, strict=True):  # one at a time, for the memory
        noise = _STILL_NOISE * float(np.std(recorded - smooth))
        steps = np.abs(np.diff(recorded))
        step = float(np.min(steps, where=steps > 0.0, initial=np.inf))
        rests = np.ptp(smooth) < max(_STILL_RANGE, noise)
        still.append(rests or np.ptp(recorded) < _STILL_STEPS * step)
    return np.array(still)


def _span(record: JointSignals, processing: ProcessingSection, cutoff: float, factor: int) -> slice:
    trim = processing.trim or [_EDGE_PERIODS / cutoff] * 2
    cut = [round(seconds * record.rate) for seconds in trim]
    samples = len(record.position)
    if samples - sum(cut) < 10 * factor:
        raise DataError(
            f"{record.name}: {samples / record.rate:.3g} s leave fewer than 10 decimated samples "
            f"after {sum(cut) / record.rate:.3g} s are cut at the ends; record for longer"
        )
    return slice(cut[0], samples - cut[1])


def decimated_motion(
    record: JointSignals,
    position: FloatArray,
    span: slice,
    processing: ProcessingSection,
    cutoff_and_factor: tuple[float, int],
    minimum_speed: FloatArray,
    couplings: Sequence[tuple[int, int]],
) -> Motion:
    """Return a filtered record (n_samples, n_joints), with the decimated samples that count."""
    cutoff, factor = cutoff_and_factor
    samples = span.stop - span.start
    edge, phase = processing.decimation_edge, processing.decimation_phase
    decimation = ParallelDecimation(factor, samples, edge, phase)
    fast = fast_samples(position[span], record.rate, minimum_speed, couplings)
    margin = processing.reversal_margin
    distance = round((REVERSAL_MARGIN if margin is None else margin) * factor)
    fast = all_around(fast, decimation, distance)
    measured = all_around(record.valid[span], decimation, factor)
    inside = np.ones(len(measured), dtype=bool)
    if processing.trim is None and decimation.factor > 1:
        inside[:_EDGE_GROUPS] = inside[-_EDGE_GROUPS:] = False
    kept = fast & measured & inside[:, None]
    dropped = {
        "slower than the reversal speed": int((inside[:, None] & measured & ~fast).sum()),
        "not measured": int((inside[:, None] & ~measured).sum()),
        "at the edges": int((~inside).sum() * kept.shape[1]),
    }
    order = processing.position_order
    return Motion(record, cutoff, order, position, span, decimation, kept, dropped)


def fast_samples(
    position: FloatArray,
    rate: float,
    minimum_speed: FloatArray,
    couplings: Sequence[tuple[int, int]],
) -> BoolArray:
    """Samples faster than the reversal speed; coupled joints must be so together, too."""
    fast = np.empty(position.shape, dtype=bool)
    for joint, motion in enumerate(position.T):
        fast[:, joint] = np.abs(np.gradient(motion, 1.0 / rate)) >= minimum_speed[joint]
    for pair in couplings:
        both = np.gradient(position[:, list(pair)].sum(axis=1), 1.0 / rate)
        fast[:, list(pair)] &= (np.abs(both) >= minimum_speed[list(pair)].min())[:, None]
    return fast


def all_around(good: BoolArray, decimation: ParallelDecimation, distance: int) -> BoolArray:
    """Whether every sample within `distance` of a decimated sample is good, (n_kept, n_joints)."""
    first = np.maximum(decimation.kept - distance, 0)
    last = np.minimum(decimation.kept + distance + 1, len(good))
    around = np.empty((len(decimation.kept), good.shape[1]), dtype=bool)
    for joint, samples in enumerate(good.T):
        bad = np.concatenate([[0], np.cumsum(~samples)])
        around[:, joint] = bad[last] == bad[first]
    return around


def torque_noise(motions: Sequence[Motion]) -> FloatArray:
    """Standard deviation that measurement noise gives a decimated torque row, (n_joints,) N m.

    The power spectral density (Welch) at frequencies well above the decimation cut-off is taken
    for that of white noise, its median over frequency, times the band that the decimation
    filter lets through. Disturbances that live at low frequencies only are not in it.
    """
    variances = []
    for motion in motions:
        rate, factor = motion.signals.rate, motion.decimation.factor
        edge = motion.decimation.edge if factor > 1 else 1.0
        band = edge * rate / (2.0 * factor)
        lowest = min(_NOISE_BAND * band, 0.375 * rate)
        variances.append(noise_density(motion.torque, rate, lowest) * band)
    return np.asarray(np.sqrt(np.mean(variances, axis=0)))


def noise_density(values: FloatArray, rate: float, lowest: float) -> FloatArray:
    """Spectral density (n_joints,) of the white noise in values (n_samples, n_joints), 1/Hz.

    The median over frequencies from `lowest`, Hz, on (Welch).
    """
    segment, levels = min(len(values), max(64, int(_SEGMENT * rate))), []
    for column in values.T:  # one after the other: windows and spectra of an hour are large
        frequency, density = scipy.signal.welch(column, fs=rate, nperseg=segment)
        levels.append(float(np.median(density[frequency >= lowest])))
    return np.array(levels)
