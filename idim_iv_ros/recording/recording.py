"""What a robot recorded, on one uniform time grid."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from idim_iv_ros.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Signal:
    """One quantity of all joints on the grid of its recording.

    Attributes
    ----------
    values : (n_samples, n_joints)
        In the unit of the source (rad or m, rad/s or m/s, what the effort topic holds).
        Finite everywhere; what was invented to make it so is marked in `invented`.
    invented : (n_samples, n_joints) bool
        True where no measurement supports the value (gap, NaN, missing joint, frozen channel).
    origin : str
        Where it comes from, in words, e.g. ``/joint_states position``.
    """

    values: FloatArray
    invented: BoolArray
    origin: str


@dataclass(frozen=True)
class Note:
    """One thing a user should know about how a recording was read.

    `topic`: empty where it is about the file. `count`: how many times. `limits`: whether
    measurements were lost, so that a user should hear of it unasked.
    """

    topic: str
    what: str
    count: int
    limits: bool = False

    @property
    def sentence(self) -> str:
        """Where, what and how often."""
        times = f" ({self.count}×)" if self.count > 1 else ""
        return f"{self.topic}{': ' if self.topic else ''}{self.what}{times}"


@dataclass(frozen=True)
class ClockQuality:
    """The time stamps of one topic as they were found.

    Times in seconds, rate in Hz; `jitter` is the standard deviation of the intervals about
    their median, `longest_gap` the longest interval.
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
    """Where one channel of a recording is frozen.

    `channel`: in words: ``effort of joint_2 on /joint_states``. `samples`: measurements that were
    left out for it. `share`: of all measurements of the channel. `first`: when the first one
    begins, s from the start of the recording. `longest`: s.
    """

    channel: str
    samples: int
    share: float
    stretches: int
    first: float
    longest: float

    @property
    def sentence(self) -> str:
        """What was found and done."""
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
        Of encoders behind the gears, joint side; all invented at a joint that has none.
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

    @property
    def samples(self) -> int:
        """Number of samples of the grid."""
        return int(self.position.values.shape[0])

    @property
    def duration(self) -> float:
        """Length of the recording in seconds."""
        return (self.samples - 1) / self.rate
