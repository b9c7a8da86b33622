"""Recordings on a uniform time grid, and sessions of recordings with a common time.

Stamps alone give no common time: recordings of a simulation all start at the same stamp, and clocks
of two runs may overlap. What depends on the time of a session (friction that fades as the robot
warms up, blocks of time, every figure) needs a time that only increases.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from idim_iv_ros.errors import UsageError, first_of
from idim_iv_ros.types import BoolArray, FloatArray, IntArray


def stretches_of(marked: BoolArray) -> tuple[IntArray, IntArray]:
    """Return the first sample of each run of marked ones (n,), and the sample behind it, (k,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]])))
    return edges[::2], edges[1::2]


@dataclass(frozen=True)
class Signal:
    """One quantity of all joints on the grid of its recording, (n_samples, n_joints).

    `values`: in the unit of the source (rad or m, rad/s or m/s, what the effort topic holds),
    finite everywhere. `invented` (bool): where no measurement supports the value (gap, NaN, missing
    joint, frozen channel). `origin`: topic and quantity, e.g. ``/joint_states position``.
    """

    values: FloatArray
    invented: BoolArray
    origin: str


@dataclass(frozen=True)
class Note:
    """One fact on how a recording was read that matters to the user.

    `topic`: empty for the whole file. `count`: how many times it occurred. `limits`: whether
    measurements were lost, so that commands show the note as a warning.
    """

    topic: str
    what: str
    count: int
    limits: bool = False

    @property
    def sentence(self) -> str:
        """Return topic, finding and count as one sentence."""
        times = f" ({self.count}×)" if self.count > 1 else ""
        return f"{self.topic}{': ' if self.topic else ''}{self.what}{times}"


@dataclass(frozen=True)
class ClockQuality:
    """Properties of the time stamps of one topic.

    Times in seconds, rate in Hz; `jitter` is the standard deviation of the usual intervals,
    `longest_gap` the longest interval. `gaps`, `repeated`, `backward` are counts.
    """

    topic: str
    source: Literal["header", "arrival"]
    messages: int
    rate: float
    jitter: float
    longest_gap: float
    gaps: int
    repeated: int
    backward: int


@dataclass(frozen=True)
class FrozenStretches:
    """Stretches of a recording in which one channel is frozen.

    `channel` in words: ``effort of joint_2 on /joint_states``. `samples`: measurements left out;
    `share`: these over all measurements of the channel. `first`: beginning of the first stretch, s
    from the start of the recording. `longest`: duration of the longest, s.
    """

    channel: str
    samples: int
    share: float
    stretches: int
    first: float
    longest: float

    @property
    def sentence(self) -> str:
        """Return a sentence on when the channel froze and what was left out."""
        times = f"{self.stretches} times" if self.stretches > 1 else "once"
        longest = "" if self.stretches == 1 else "the longest "
        return (
            f"{self.channel} freezes {times} while the joint moves, first {self.first:.4g} s after "
            f"the start, {longest}for {self.longest:.3g} s; {self.samples} samples "
            f"({100.0 * self.share:.2g} %) are left out; look at the sensor and its bus"
        )


@dataclass(frozen=True)
class Recording:
    """One bag of one robot, resampled on a uniform grid; immutable.

    Attributes
    ----------
    path : Path
        The bag it was read from.
    joints : tuple of str
        The identified joints, in the order of the configuration; the columns of all signals.
    rate : float
        Samples per second of the grid, Hz.
    start : float
        Time of the first sample, s, on the clock of the bag.
    position, effort : Signal
        Measured position and effort, as recorded (no scale, offset or gear ratio applied).
    velocity, position_reference, velocity_reference : Signal or None
        None where the bag has none.
    clocks : tuple of ClockQuality
        One for each topic that was read.
    notes : tuple of Note
        What was dropped, reordered or repaired while reading.
    robot_description : str or None
        URDF found in the bag.
    frozen : tuple of FrozenStretches
        Channels that held their last value while the joint moved; these samples are invented.
    unused_references : tuple of str
        Where there is no reference: other topics with positions of all joints, likely ones first.
    link_position : Signal or None
        Positions by encoders behind the gears, joint side; invented at joints without one.
    other_positions : dict of str to (float, float)
        Least and largest position of joints of the bag that are not identified, rad (m).
    """

    path: Path
    joints: tuple[str, ...]
    rate: float
    start: float
    position: Signal
    effort: Signal
    velocity: Signal | None
    position_reference: Signal | None
    velocity_reference: Signal | None
    clocks: tuple[ClockQuality, ...]
    notes: tuple[Note, ...]
    robot_description: str | None
    frozen: tuple[FrozenStretches, ...] = ()
    unused_references: tuple[str, ...] = ()
    link_position: Signal | None = None
    other_positions: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def samples(self) -> int:
        """Number of samples of the grid."""
        return int(self.position.values.shape[0])

    @property
    def duration(self) -> float:
        """Length of the recording in seconds."""
        return (self.samples - 1) / self.rate


# s; a robot that rested for longer has cooled down, or the stamps are of two different clocks.
LONGEST_PAUSE = 3600.0
_LISTED = 6  # recordings that are listed one by one in a sentence


@dataclass(frozen=True)
class SessionPart:
    """Place of one recording in its session: `start` from its start, and `duration`, s.

    `bag`: name of its file or folder, with the path where two have the same name.
    """

    bag: str
    start: float
    duration: float


@dataclass(frozen=True)
class Session:
    """Recordings by their first stamps, with a common time, in which no `parts` overlap."""

    recordings: tuple[Recording, ...]
    parts: tuple[SessionPart, ...]
    sentences: tuple[str, ...]  # how stamps became the time of the session; empty for one recording


def session_of(recordings: Sequence[Recording]) -> Session:
    """Return recordings as a session, in the order of their first stamps.

    A pause between recordings keeps its length (the robot cools down in it) up to `LONGEST_PAUSE`.
    A recording that begins before another one ends follows it without a pause. Time starts with the
    first sample of the first recording.

    Raises UsageError: there is no recording.
    """
    if not recordings:
        raise UsageError("no recording is given; name at least one bag")
    ordered = tuple(sorted(recordings, key=lambda recording: recording.start))
    names = [recording.path.name for recording in ordered]
    parts: list[SessionPart] = []
    overlapping, shortened = [], []
    end, stamp = 0.0, ordered[0].start
    for recording in ordered:
        name = recording.path.name if names.count(recording.path.name) == 1 else str(recording.path)
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
    return Session(ordered, tuple(parts), tuple(_sentences(parts, overlapping, shortened)))


def in_recordings(parts: Sequence[SessionPart], low: float, high: float) -> str:
    """Return `low` to `high`, s of the session, in recordings: "9.9 to 15 s of run2.mcap"."""
    place = int(np.searchsorted([part.start for part in parts], low, side="right")) - 1
    first = parts[max(place, 0)]
    since = low - first.start
    # The end belongs to the recording before, where the next one starts there.
    last = [part for part in parts if part.start < high][-1] if high > parts[0].start else first
    until = min(high - last.start, last.duration)
    if first == last:
        return f"{_seconds_text(since)} to {_seconds_text(until)} s of {last.bag}"
    return f"{_seconds_text(since)} s of {first.bag} to {_seconds_text(until)} s of {last.bag}"


def _seconds_text(seconds: float) -> str:
    return f"{seconds:.0f}" if seconds >= 1000.0 else f"{seconds:.3g}"


def _sentences(
    parts: Sequence[SessionPart], overlapping: Sequence[str], shortened: Sequence[str]
) -> Iterator[str]:
    """Say how stamps became the time of a session; nothing of a single recording."""
    if len(parts) < 2:
        return
    begins = [f"{part.bag} from {_seconds_text(part.start)} s" for part in parts]
    yield (
        "recordings follow one another in the order of their first stamps; time of the session: "
        f"{first_of(begins, _LISTED)}"
    )
    if overlapping:
        yield (
            f"stamps of {first_of(overlapping, _LISTED)} begin before those of another recording "
            "end: placed after it without a pause, so that what changes during the session is "
            "known in this order only"
        )
    if shortened:
        yield f"a pause counts as {LONGEST_PAUSE:.0f} s at most: {first_of(shortened, _LISTED)}"
