"""Something that commands or torques hold at a certain time and their model does not."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.statistics.residuals import excess_kurtosis
from idim_iv_ros.types import FloatArray

_EDGE = 0.5  # of the peak of an event, where it begins and ends
_LEAST_EVENT = 0.1  # of the energy of the largest event, to be listed


@dataclass(frozen=True)
class LawEvent:
    """One stretch of time.

    Attributes
    ----------
    begin, end : float
        s, of the recording.
    recording : int
    size : float
        Its median, N m (N).
    energy : float
        Sum of squares over its rows.
    """

    begin: float
    end: float
    recording: int
    size: float
    energy: float


def events_in(rest: FloatArray, recording: NDArray[np.int64], time: FloatArray) -> list[LawEvent]:
    """Find the events in what a model leaves, the largest first; none where it acts all the time.

    An event begins and ends where it falls below a share of its own peak: filters smear it, and
    the loop swings after it.

    Parameters
    ----------
    rest, recording, time
        (r,) N m (N); which recording a row belongs to; s.
    """
    energy = rest**2
    if excess_kurtosis(rest) < settings.LAW_EVENT_KURTOSIS:
        return []
    large = np.flatnonzero(np.abs(rest) > settings.LAW_EVENT_SIZE * np.median(np.abs(rest)))
    if len(large) == 0:
        return []
    apart = np.diff(time[large]) > settings.LAW_EVENTS_APART
    parts = np.split(large, np.flatnonzero((np.diff(recording[large]) != 0) | apart) + 1)
    events = []
    for part in parts:
        peak = float(np.abs(rest[part]).max())
        core = part[np.abs(rest[part]) >= _EDGE * peak]
        events.append(
            LawEvent(
                begin=float(time[core[0]]),
                end=float(time[core[-1]]),
                recording=int(recording[core[0]]),
                size=float(np.median(rest[core])),
                energy=float(energy[part].sum()),
            )
        )
    events.sort(key=lambda event: -event.energy)
    least = _LEAST_EVENT * events[0].energy
    return [event for event in events if event.energy >= least]


def beside_no_event(
    residual: FloatArray, recording: NDArray[np.int64], time: FloatArray
) -> NDArray[np.bool_]:
    """Rows (r,) half a second or more from what commands hold beyond their law, if that is brief.

    A pulse in the command pushes the robot, and the law answers: errors follow pulses, so that any
    gain, a lag and a late speed take a part of them. What the law is shows between them.

    Parameters
    ----------
    residual, recording, time
        (r,) what the law leaves, N m (N); which recording a row belongs to; s.
    """
    kept = np.ones(len(residual), dtype=bool)
    if excess_kurtosis(residual) <= settings.LAW_EVENT_KURTOSIS:
        return kept
    size = np.abs(residual)
    event = size > settings.LAW_EVENT_SIZE * float(np.median(size))
    for number in np.unique(recording):
        own = np.flatnonzero(recording == number)
        for begin in time[own][event[own]]:
            kept[own] &= np.abs(time[own] - begin) > settings.LAW_EVENTS_APART
    return kept if int(kept.sum()) >= settings.LEAST_ROWS else np.ones_like(kept)
