"""Cut-off frequencies: checked when the user gives them, proposed from the data otherwise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.configuration import ProcessingSection
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.signals.decimation import common_factors
from idim_iv_ros.signals.joint_side import JointSignals
from idim_iv_ros.types import FloatArray

# The paper filters positions at 50 Hz and decimates at 20 Hz; EMPS is filtered at 100 and 40 Hz.
DECIMATION_SHARE = 0.4
_LEAST_CUTOFF = 5.0  # Hz, proposed where the motion is slow or noisy: loops are faster than that
_MOTION_TO_NOISE = 10.0  # power over the noise floor that counts as motion
_HIGHEST_CUTOFF = 0.8  # of the Nyquist frequency, for the positions


@dataclass(frozen=True)
class Cutoffs:
    """What the signals are filtered with, and why."""

    position: float  # Hz
    decimation: float  # Hz
    factors: tuple[int, ...]  # of the decimation of each recording
    row_rate: float  # decimated samples per second, the same for all recordings, Hz
    reasons: tuple[str, ...]  # one sentence for each value that was proposed or derived


def choose_cutoffs(
    processing: ProcessingSection, records: Sequence[JointSignals], source: str
) -> Cutoffs:
    """Check the given cut-offs against the rates and each other; propose what is not given.

    The cut-offs hold for all recordings, so that the slowest one limits them. Each recording is
    decimated by its own factor, to one rate of the rows.

    `records`: all recordings; `source`: the configuration file, for messages.

    Raises UsageError: a cut-off contradicts a rate or the other cut-off; DataError: no decimation
    brings all recordings to one rate.
    """
    slowest = min(records, key=lambda record: record.rate)
    rate, name = slowest.rate, f" of {slowest.name}" if len(records) > 1 else ""
    for key in ("position_cutoff", "decimation_cutoff"):
        value = getattr(processing, key)
        if value is not None and value >= rate / 2.0:
            raise UsageError(
                f"{source}: processing.{key} is {value:g} Hz, but at the {rate:g} samples per "
                f"second{name} nothing above {rate / 2.0:g} Hz is recorded"
            )
    reasons: list[str] = []
    position, decimation = processing.position_cutoff, processing.decimation_cutoff
    if position is None:
        bandwidth = max(motion_bandwidth(record.position, record.rate) for record in records)
        wanted = max(bandwidth, _LEAST_CUTOFF, (decimation or 0.0) / DECIMATION_SHARE)
        position = float(f"{min(wanted, _HIGHEST_CUTOFF * rate / 2.0):.2g}")
        reasons.append(
            f"position cut-off {position:g} Hz proposed: the measured motion stands above the "
            f"position noise up to {bandwidth:.3g} Hz"
        )
    if decimation is None:
        decimation = float(f"{DECIMATION_SHARE * position:.3g}")
        reasons.append(
            f"decimation cut-off {decimation:g} Hz proposed: {DECIMATION_SHARE:g} of the position "
            "cut-off, the paper's ratio"
        )
    if decimation > position:
        raise UsageError(
            f"{source}: processing.decimation_cutoff {decimation:g} Hz is above "
            f"position_cutoff {position:g} Hz: the torque would hold frequencies that the "
            "filtered positions have lost"
        )
    rates = [record.rate for record in records]
    common = common_factors(rates, decimation, processing.decimation_edge)
    if common is None:
        names = {record.rate: record.name for record in reversed(records)}
        listed = ", ".join(f"{names[rate]} with {rate:g} Hz" for rate in dict.fromkeys(rates))
        raise DataError(
            f"{listed}: no decimation that leaves {decimation:g} Hz "
            f"(processing.decimation_cutoff of {source}) brings them to one rate; identify them "
            "one by one, record at rates of which one is a multiple of the other, or lower the "
            "cut-off"
        )
    factors, row_rate = common
    if min(factors) == 1:
        reasons.append(
            f"not decimated: {decimation:g} Hz needs more than half of the {rate:g} samples per "
            f"second{name}"
        )
    if len({round(record.rate / rate, 3) for record in records}) > 1:
        listed = ", ".join(
            f"{record.name} with {record.rate:g} Hz by {factor}"
            for record, factor in zip(records, factors, strict=True)
        )
        reasons.append(
            f"recordings of different rates are decimated to {row_rate:.5g} rows per second: "
            f"{listed}; all are filtered at the same frequencies, which the slowest one limits; "
            "nothing is interpolated"
        )
    return Cutoffs(position, decimation, factors, row_rate, tuple(reasons))


def motion_bandwidth(position: FloatArray, rate: float) -> float:
    """Highest frequency, Hz, at which the motion of any joint stands above its position noise.

    The noise floor is the median of the power spectral density (Welch) over the upper half of
    the frequencies; the motion ends where the density first falls below ten times that floor.

    Raises DataError: the recording is too short for a spectrum.
    """
    if len(position) < 64:
        raise DataError(f"{len(position)} samples are too few to measure a bandwidth")
    segment = min(len(position), max(64, int(8.0 * rate)))
    highest = 0.0
    for joint in position.T:  # one at a time, for the sake of memory
        frequency, density = scipy.signal.welch(joint, fs=rate, nperseg=segment, detrend="linear")
        floor = float(np.median(density[frequency > rate / 4.0]))
        still = np.append(density[1:] <= _MOTION_TO_NOISE * floor, True)
        highest = max(highest, float(frequency[max(int(np.argmax(still)), 1)]), 4.0 * frequency[1])
    return float(highest)
