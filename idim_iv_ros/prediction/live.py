"""Prediction of a running robot's efforts from what has arrived so far.

Positions pass through the filter of the identification, forward and backward, over a window that
slides; a sample waits for what its impulse response needs of later samples (`lag`). Two answers
come of it:

- **curves**, as early as that allows: efforts measured and predicted, both smoothed by the same
  zero-phase filter;
- **rows**, about a second later: the residual through the parallel decimation of the
  identification, on samples that count there too. Only these are compared with its noise floor.
"""

from dataclasses import dataclass
from itertools import compress

import numpy as np

from idim_iv_ros.prediction.identified_model import IdentifiedModel
from idim_iv_ros.prediction.rows import ResidualRows
from idim_iv_ros.prediction.stream import JointSamples, SampleStream
from idim_iv_ros.prediction.window import PredictionWindow
from idim_iv_ros.types import FloatArray

SHARE_SECONDS = 1.0  # of rows behind the share of the noise floor

_LONGEST_PAUSE = 1.0  # s
_SILENT, _SILENT_INTERVALS = 0.5, 5.0  # s, sampling intervals
_MOST = 5_000_000_000  # ns of samples that are kept at most
_LEAST_ROWS = 5  # that count, behind a share


@dataclass(frozen=True)
class Prediction:
    """One sample of the curves and the newest shares; see the message of that name.

    Arrays are (n_joints,), in N m (N); NaN where there is no number.
    """

    stamp: int  # Of the sample, ns; of the newest sample where nothing is predicted, 0 without any
    reason: str  # Why nothing is predicted; empty where something is
    measured: FloatArray
    predicted: FloatArray
    residual: FloatArray
    noise_share: FloatArray


class LivePrediction:
    """Takes samples as they come and predicts the newest that its filters reach.

    Parameters
    ----------
    identified : IdentifiedModel
    one_topic : bool
        Whether positions and efforts come in the same messages.

    Attributes
    ----------
    rows : ResidualRows
        Residual at the rows, for everything that is said of its size.
    rate : float or None
        Of the samples, Hz; None while it is measured.
    """

    def __init__(self, identified: IdentifiedModel, *, one_topic: bool = True) -> None:
        self.identified = identified
        joints = len(identified.joints)
        self._positions = SampleStream(identified.turning, _LONGEST_PAUSE)
        self._efforts = SampleStream((False,) * joints, _LONGEST_PAUSE)
        self._streams = {"position": self._positions, "effort": self._efforts}
        self._one_topic = one_topic
        self._window: PredictionWindow | None = None
        self._why = ""
        self._rates: dict[str, float] = {}
        self._arrived = dict.fromkeys(self._streams, 0)
        self.rows = ResidualRows(joints, 1.0)

    @property
    def rate(self) -> float | None:
        """Rate of the grid, Hz."""
        return None if self._window is None else self._window.rate

    @property
    def lag(self) -> float | None:
        """From a sample until it can be predicted, s; None while the rate is measured."""
        return None if self._window is None else self._window.lag

    @property
    def late(self) -> int:
        """Samples that were left out since their stamps are not in order."""
        return self._positions.late + (0 if self._one_topic else self._efforts.late)

    def add(self, positions: JointSamples, efforts: JointSamples, now: int) -> None:
        """Take samples in the order of their arrival, as they are recorded.

        - `positions`, `efforts`: as the topics hold them
        - `now`: when they arrived, ns
        """
        for (name, stream), new in zip(self._streams.items(), (positions, efforts), strict=True):
            before = stream.reached
            stream.add(new)
            if stream.reached != before:
                self._arrived[name] = now
            if len(new):
                stream.forget(int(stream.samples.time[-1]) - _MOST)
        restarted = self._positions.restarted or self._efforts.restarted
        if restarted:
            self._begin_again(restarted)

    def _begin_again(self, why: str) -> None:
        self._window, self._why = None, f"{why}: filtering begins anew"
        for stream in self._streams.values():
            if not stream.restarted:
                stream.clear()

    def newest(self, now: int) -> Prediction:
        """Predict the newest sample that the filters reach.

        - `now`: ns, of the same clock as that of `add`
        """
        reason = self._not_usable(now)
        if not reason and self._window is None:
            reason = self._measure_rate()
        window = self._window
        if reason or window is None:
            return self._nothing(reason)
        until = min(stream.reached for stream in self._streams.values())
        curve = window.advance(self._positions.samples, self._efforts.samples, until, self.rows)
        for stream in self._streams.values():
            stream.forget(window.needed)
        if curve is None:
            why = f"{self._why}; " if self._why else ""
            return self._nothing(f"{why}the filters fill: {window.missing:.1f} s to go")
        self._why = ""
        stamp, measured, predicted = curve
        floor = self.identified.noise_floor
        share = self.rows.share(SHARE_SECONDS, _LEAST_ROWS) / np.where(floor > 0.0, floor, np.nan)
        return Prediction(stamp, "", measured, predicted, measured - predicted, share)

    def _not_usable(self, now: int) -> str:
        """Say why the samples cannot be used; empty where they can."""
        for name, stream in self._streams.items():
            if len(stream.samples) == 0:
                return f"no {name} has arrived"
            silent = (now - self._arrived[name]) * 1e-9
            if silent > max(_SILENT, _SILENT_INTERVALS * (stream.interval or 0.0)):
                return f"no {name} for {silent:.1f} s"
            joints = self.identified.joints
            missing = list(compress(joints, stream.missing()))
            if missing and (name == "position" or len(missing) == len(joints)):
                return f"no {name} of {', '.join(missing)} in the messages"
            if self._window is not None and stream.has_other_rate(self._rates[name]):
                new = 1.0 / (stream.interval or 1.0)
                self._begin_again(
                    f"the rate of the {name} changed from {self._rates[name]:.4g} to {new:.4g} Hz"
                )
                # Of the samples before the change there are none left to measure a rate from.
                return self._why
        return ""

    def _measure_rate(self) -> str:
        position, effort = self._positions.rate(), self._efforts.rate()
        if position is None or effort is None:
            return self._why or "measuring the rate of the samples"
        cutoff = self.identified.result.processing.position_cutoff
        if cutoff >= position / 2.0:
            return (
                f"positions come at {position:.4g} Hz, and the result was made with a cut-off of "
                f"{cutoff:g} Hz: more than {2.0 * cutoff:g} Hz are needed"
            )
        start = max(int(self._positions.samples.time[0]), int(self._efforts.samples.time[0]))
        self._window = PredictionWindow(self.identified, position, start)
        self._rates = {"position": position, "effort": effort}
        self.rows = ResidualRows(len(self.identified.joints), self._window.row_rate)
        return ""

    def _nothing(self, reason: str) -> Prediction:
        absent = np.full(len(self.identified.joints), np.nan)
        times = self._positions.samples.time
        stamp = int(times[-1]) if len(times) else 0
        return Prediction(stamp, reason, absent, absent, absent, absent)
