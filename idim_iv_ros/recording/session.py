"""One time for a session of several recordings: one after the other, by their first stamps.

Stamps alone do not give such a time: recordings of a simulation all start at the same one, and
clocks of two runs may overlap. What depends on the time of a session (friction that fades as the
robot warms up, blocks of time, every figure) needs one that only ever increases.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.errors import UsageError
from idim_iv_ros.recording.recording import Recording

# s; a robot that rested for longer has cooled down, or the stamps are of two different clocks.
LONGEST_PAUSE = 3600.0
# Recordings that are listed one by one in a sentence.
_LISTED = 6


@dataclass(frozen=True)
class SessionPart:
    """Where one recording lies in its session.

    `bag`: name of its file or folder, with the path where two have the same name. `start`,
    `duration`: s, of the session and of the recording.
    """

    bag: str
    start: float
    duration: float


@dataclass(frozen=True)
class Session:
    """Recordings in the order of their first stamps, and the time that they share.

    `parts`: one for each recording; they do not overlap. `sentences`: how stamps became the time of
    the session; empty for a single recording.
    """

    recordings: tuple[Recording, ...]
    parts: tuple[SessionPart, ...]
    sentences: tuple[str, ...]


def session_of(recordings: Sequence[Recording]) -> Session:
    """Put recordings one after the other, whatever the order in which they are given.

    They follow the order of their first stamps, equal stamps the order in which they are given.
    A pause between two keeps its length, for a robot warms up and cools down in it, up to
    `LONGEST_PAUSE`. A recording whose stamps begin before another one ends follows without a
    pause. The time of the session starts with the first sample of the first recording.

    Raises UsageError: there is none.
    """
    if not recordings:
        raise UsageError("no recording is given; name at least one bag")
    ordered = tuple(sorted(recordings, key=lambda recording: recording.start))
    names = _names(ordered)
    parts: list[SessionPart] = []
    overlapping, shortened = [], []
    end, stamp = 0.0, ordered[0].start
    for name, recording in zip(names, ordered, strict=True):
        pause = recording.start - stamp
        # Less than half a sample is rounding of the stamps.
        if pause < -0.5 / recording.rate:
            overlapping.append(name)
        elif pause > LONGEST_PAUSE:
            shortened.append(f"{pause:.3g} s before {name}")
        start = end + min(max(pause, 0.0), LONGEST_PAUSE)
        parts.append(SessionPart(name, start, recording.duration))
        # One sample more than the duration: the next recording never starts at the last sample.
        length = recording.samples / recording.rate
        end, stamp = start + length, max(stamp, recording.start + length)
    return Session(ordered, tuple(parts), _sentences(parts, overlapping, shortened))


def in_recordings(parts: Sequence[SessionPart], low: float, high: float) -> str:
    """A stretch of the session in the times of its recordings, "9.9 to 15 s of run2.mcap"."""
    place = int(np.searchsorted([part.start for part in parts], low, side="right")) - 1
    first = parts[max(place, 0)]
    since = low - first.start
    # The end belongs to the recording before, where the next one starts there.
    last = [part for part in parts if part.start < high][-1] if high > parts[0].start else first
    until = min(high - last.start, last.duration)
    if first == last:
        return f"{_short(since)} to {_short(until)} s of {last.bag}"
    return f"{_short(since)} s of {first.bag} to {_short(until)} s of {last.bag}"


def _short(seconds: float) -> str:
    """Three digits; beyond a thousand whole seconds."""
    return f"{seconds:.0f}" if seconds >= 1000.0 else f"{seconds:.3g}"


def _names(recordings: Sequence[Recording]) -> list[str]:
    names = [recording.path.name for recording in recordings]
    return [
        name if names.count(name) == 1 else str(recording.path)
        for name, recording in zip(names, recordings, strict=True)
    ]


def _sentences(
    parts: Sequence[SessionPart], overlapping: Sequence[str], shortened: Sequence[str]
) -> tuple[str, ...]:
    if len(parts) < 2:
        return ()
    listed = [f"{part.bag} from {_short(part.start)} s" for part in parts[:_LISTED]]
    more = f" and {len(parts) - _LISTED} more" if len(parts) > _LISTED else ""
    sentences = [
        "recordings follow one another in the order of their first stamps; time of the session: "
        f"{', '.join(listed)}{more}"
    ]
    if overlapping:
        sentences.append(
            f"stamps of {', '.join(overlapping[:_LISTED])} begin before those of another recording "
            "end: placed after it without a pause, so that what changes during the session is "
            "known in this order only"
        )
    if shortened:
        sentences.append(
            f"a pause counts as {LONGEST_PAUSE:.0f} s at most: {', '.join(shortened[:_LISTED])}"
        )
    return tuple(sentences)
