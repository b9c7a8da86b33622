"""Commands of one joint beside its configured law: rows, the speed of the law, and events."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.likelihood import rms
from idim_iv_ros.effects.contribution import CommandParts
from idim_iv_ros.effects.registry import CONTROL_LAW
from idim_iv_ros.estimation.observation import segments_of
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.signals import JointSignals, Motion, shifted
from idim_iv_ros.signals.motion import all_around
from idim_iv_ros.simulation import ControlLaw
from idim_iv_ros.statistics.residuals import excess_kurtosis
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

TIMES = 5  # errors of time: a lag of the effort, position, speed, and the references of both
_LATE = 0.5  # control periods that what the law sees, and what is recorded, are likely late
_LIMITED = 0.98  # of the torque limit, from which on a command is limited
_EDGE = 0.5  # of the peak of an event, where it begins and ends
_LEAST_EVENT = 0.1  # of the energy of the largest event, to be listed
_LAG_STEPS = 4  # at most, of the search for a lag
_LEAST_STEP = 0.999  # of what is left, which a step must come below
_ROWS = ("rest", "errors", "recording", "time", "second")  # fields with a value for each row


@dataclass(frozen=True)
class LawSpeed:
    """One way to obtain the speed of a joint.

    ``central`` differences of the position (no lateness), the ``recorded`` velocity, or backward
    differences through a first-order filter (``filtered``), v[k] = v[k-1] + factor (Δq[k] / Δt −
    v[k-1]): a factor of 1 is no filter.
    """

    kind: Literal["central", "recorded", "filtered"] = "central"
    factor: float = 1.0

    def of(self, signals: JointSignals, joint: int) -> FloatArray:
        """Speed (n_samples,) of one joint, rad/s (m/s)."""
        if self.kind == "recorded" and signals.velocity is not None:
            return signals.velocity[:, joint]
        position = signals.position[:, joint]
        if self.kind != "filtered":
            return np.gradient(position, 1.0 / signals.rate)
        difference = np.diff(position, prepend=position[:1]) * signals.rate
        if len(difference) > 1:
            difference[0] = difference[1]
        rest = (1.0 - self.factor) * difference[0]
        filtered, _ = scipy.signal.lfilter(
            [self.factor], [1.0, self.factor - 1.0], difference, zi=[rest]
        )
        return np.asarray(filtered)

    def lateness(self, rate: float) -> float:
        """Delay at low frequencies, s, of a speed that is computed at `rate` (Hz)."""
        if self.kind != "filtered":
            return 0.0
        return ((1.0 - self.factor) / self.factor + 0.5) / rate

    @property
    def words(self) -> str:
        """What it is, for the report."""
        if self.kind == "recorded":
            return "the recorded velocity"
        if self.kind == "central":
            return "central differences of the position"
        if self.factor == 1.0:
            return "backward differences of the position"
        through = f"through a first-order filter of factor {self.factor:.2g}"
        return f"backward differences of the position {through}"


@dataclass(frozen=True)
class CommandRows:
    """Decimated rows of one joint, without those at the torque limit; (r,) each.

    `rest`: recorded less computed command, N m (N); `size`: RMS of the recorded one; `groups`:
    torque of a unit of each group that may change. `errors` (r, e): torque of a unit of what a
    recording does to commands that are those of the law: a lag of the effort; position, speed and
    the references of both late, s; `likely` (e,): how large each of them is. `runs`: rows without a
    gap in time; `time`: from the start of the recording, s; `second`: rows of a second set of
    recordings. `lag`: by which what the law gives is already taken later, s.
    """

    rest: FloatArray
    size: float
    groups: dict[str, FloatArray]
    errors: FloatArray
    likely: FloatArray
    runs: tuple[slice, ...]
    recording: IntArray
    time: FloatArray
    second: BoolArray
    lag: float = 0.0

    @property
    def constants(self) -> FloatArray:
        """(r, recordings)."""
        return np.asarray(self.recording[:, None] == np.unique(self.recording), dtype=float)

    def only(self, kept: BoolArray) -> "CommandRows":
        """Leave out the rows that are not `kept` (r,)."""
        return replace(
            self,
            **{name: getattr(self, name)[kept] for name in _ROWS},
            groups={name: torque[kept] for name, torque in self.groups.items()},
            runs=segments_of([kept[run] for run in self.runs]),
        )

    def followed_by(self, other: "CommandRows") -> "CommandRows":
        """Rows of two sets, each with errors of its own."""
        first = len(self.rest)
        groups = [
            np.concatenate([torque, other.groups[name]]) for name, torque in self.groups.items()
        ]
        return CommandRows(
            rest=np.concatenate([self.rest, other.rest]),
            size=max(self.size, other.size),
            groups=dict(zip(self.groups, groups, strict=True)),
            errors=scipy.linalg.block_diag(self.errors, other.errors),
            likely=np.concatenate([self.likely, other.likely]),
            runs=(*self.runs, *(slice(first + r.start, first + r.stop) for r in other.runs)),
            recording=np.concatenate([self.recording, other.recording + self.recording.max() + 1]),
            time=np.concatenate([self.time, other.time]),
            second=np.repeat([False, True], [first, len(other.rest)]),
        )


class LawCommands:
    """Recorded commands of all joints beside one law; rows are made once and used again.

    `motions`: filtered, with references; `law`: with the period of the control, s.
    """

    def __init__(self, motions: Sequence[Motion], law: ControlLaw) -> None:
        self.motions, self.law = tuple(motions), law
        self._late: dict[tuple[int, LawSpeed], CommandRows | None] = {}
        self._faster: dict[tuple[int, LawSpeed, float], FloatArray] = {}

    @property
    def interval(self) -> float:
        """Longest time between two samples of a recording, s."""
        return 1.0 / min(motion.signals.rate for motion in self.motions)

    @property
    def period(self) -> float:
        """Of the control, s; unless the law has one, that of the samples."""
        return self.interval if self.law.period is None else self.law.period

    def rows(self, joint: int, speed: LawSpeed, lag: float = 0.0) -> CommandRows | None:
        """Evaluate the law on the measured motion; None where too few rows are left.

        `lag`: by which what the law gives is taken later, s. What the law sees, and is recorded, is
        about as late as a period of the control.
        """
        every = [self._comparable(motion, joint) for motion in self.motions]
        counts = [int(kept.sum()) for kept in every]
        if sum(counts) < settings.LEAST_ROWS:
            return None
        tables = []
        for motion, kept in zip(self.motions, every, strict=True):
            parts, _ = self._evaluated(motion, joint, speed)
            recorded = motion.signals.torque[:, joint]
            groups = [parts.groups[name] for name in CONTROL_LAW.groups]
            given = np.stack([parts.command, -parts.rate, *parts.late.T, *groups])
            if lag != 0.0:
                given = shifted(given.T, lag, motion.signals.rate).T
            table = np.vstack([recorded, recorded - given[0], given[1:]])
            decimated = motion.decimation.whole(table[:, motion.span].T)
            tables.append(np.column_stack([motion.time, decimated])[kept])
        table = np.concatenate(tables)
        first, late = 3 + TIMES, settings.LONGEST_LAG * max(self.period, self.interval)
        return CommandRows(
            rest=table[:, 2],
            size=rms(table[:, 1]),
            groups={name: table[:, first + k] for k, name in enumerate(CONTROL_LAW.groups)},
            errors=table[:, 3:first],
            likely=np.array([late, *[_LATE * self.period] * 4]),
            runs=segments_of(every),
            recording=np.repeat(np.arange(len(counts)), counts),
            time=table[:, 0],
            second=np.zeros(len(table), dtype=bool),
            lag=lag,
        )

    def late(self, joint: int, speed: LawSpeed) -> CommandRows | None:
        """`rows` with the law as late as the commands are.

        A lag is no small error where commands swing fast: of what it does to them, the part that
        grows with its square would pass for a change of a gain. It is approached in steps, as long
        as they leave less beside all that the law may have otherwise.
        """
        if (joint, speed) not in self._late:
            rows = self.rows(joint, speed)
            self._late[joint, speed] = rows and self._later(joint, speed, rows)
        return self._late[joint, speed]

    def faster(self, joint: int, speeds: Sequence[LawSpeed], lag: float) -> list[FloatArray]:
        """Rows (r,) by which other speeds are above the plain one, where no limit acts.

        `lag`: by which they are taken later, s.
        """
        new = [speed for speed in speeds if (joint, speed, lag) not in self._faster]
        parts = []
        for motion in self.motions if new else ():
            signals, (_, free) = motion.signals, self._evaluated(motion, joint, LawSpeed())
            plain = LawSpeed().of(signals, joint)
            changes = np.stack([(speed.of(signals, joint) - plain) * free for speed in new])
            moved = shifted(changes.T, lag, signals.rate)[motion.span]
            parts.append(motion.decimation.whole(moved)[self._comparable(motion, joint)])
        for speed, *rows in zip(new, *(part.T for part in parts), strict=True):
            self._faster[joint, speed, lag] = np.concatenate(rows)
        return [self._faster[joint, speed, lag] for speed in speeds]

    def _later(self, joint: int, speed: LawSpeed, rows: CommandRows) -> CommandRows:
        step, rest = _lag_alone(rows)
        for _ in range(_LAG_STEPS):
            later = self.rows(joint, speed, rows.lag + step)
            if later is None:
                break
            step, left = _lag_alone(later)
            if left >= _LEAST_STEP * rest:
                break
            rows, rest = later, left
        return rows

    def _evaluated(
        self, motion: Motion, joint: int, speed: LawSpeed
    ) -> tuple[CommandParts, BoolArray]:
        """Parts of one joint's command, and where it is not at the torque limit (n_samples,).

        Rows at the limit do not count, but filters carry what a command is beyond it for half a
        second.
        """
        signals, limit = motion.signals, float(self.law.torque_limit[joint])
        parts = CONTROL_LAW.parts(signals, self.law, joint, speed.of(signals, joint))
        free = np.abs(parts.command) < limit
        if free.all():
            return parts, free
        command = np.clip(parts.command, -limit, limit)
        groups = {name: torque * free for name, torque in parts.groups.items()}
        slope = np.gradient(command, 1.0 / signals.rate)
        late = parts.late * free[:, None]
        return replace(parts, command=command, rate=slope, late=late, groups=groups), free

    def _comparable(self, motion: Motion, joint: int) -> BoolArray:
        """Decimated samples (m,) at which a command is measured and not at the torque limit.

        Nor near a sample of which that is not so, nor near the ends.
        """
        signals = motion.signals
        limit = _LIMITED * float(self.law.torque_limit[joint])
        good = signals.valid[:, joint] & (np.abs(signals.torque[:, joint]) < limit)
        kept = all_around(good[motion.span, None], motion.decimation, motion.decimation.factor)
        kept[:2] = kept[-2:] = False
        return np.asarray(kept[:, 0])


def _lag_alone(rows: CommandRows) -> tuple[float, float]:
    """Lag, s, that would explain the most alone; RMS of what all changes leave, N m (N)."""
    constants = independent_basis(rows.constants)
    rest, rate = constants.remove(rows.rest), constants.remove(rows.errors[:, 0])
    whole = independent_basis(np.column_stack([rows.constants, rows.errors, *rows.groups.values()]))
    step = float(rate @ rest) / max(float(rate @ rate), 1e-300)
    return step, rms(whole.remove(rows.rest))


@dataclass(frozen=True)
class LawEvent:
    """A stretch of time in which commands hold something that their law does not.

    `begin`, `end`: s of the `recording`; `size`: its median, N m (N); `energy`: sum of squares.
    """

    begin: float
    end: float
    recording: int
    size: float
    energy: float


def _in_events(rest: FloatArray) -> BoolArray:
    """Rows (r,) that belong to events; none where what a model leaves acts all the time."""
    if excess_kurtosis(rest) < settings.LAW_EVENT_KURTOSIS:
        return np.zeros(len(rest), dtype=bool)
    size = np.abs(rest)
    return np.asarray(size > settings.LAW_EVENT_SIZE * np.median(size))


def events_in(rest: FloatArray, recording: IntArray, time: FloatArray) -> list[LawEvent]:
    """Find the events in what a model leaves, the largest first; none where it acts all the time.

    An event begins and ends where it falls below a share of its own peak: filters smear it, and the
    loop swings after it.

    `rest`, `recording`, `time`: (r,) N m (N); which recording a row belongs to; s.
    """
    large = np.flatnonzero(_in_events(rest))
    if len(large) == 0:
        return []
    apart = np.diff(time[large]) > settings.LAW_EVENTS_APART
    events = []
    for part in np.split(large, np.flatnonzero((np.diff(recording[large]) != 0) | apart) + 1):
        size = np.abs(rest[part])
        core = part[size >= _EDGE * size.max()]
        begin, end = time[core[[0, -1]]].tolist()
        middle, energy = float(np.median(rest[core])), float(np.sum(rest[part] ** 2))
        events.append(LawEvent(begin, end, int(recording[core[0]]), middle, energy))
    events.sort(key=lambda event: -event.energy)
    return [event for event in events if event.energy >= _LEAST_EVENT * events[0].energy]


def away_from_events(rest: FloatArray, recording: IntArray, time: FloatArray) -> BoolArray:
    """Rows (r,) half a second or more from the events in what the law leaves; all if few remain.

    A pulse in the command pushes the robot, and the law answers: errors follow pulses, so that any
    gain, a lag and a late speed take a part of them. What the law is shows between them.
    Parameters are those of `events_in`.
    """
    kept = np.ones(len(rest), dtype=bool)
    for row in np.flatnonzero(_in_events(rest)):
        near = np.abs(time - time[row]) <= settings.LAW_EVENTS_APART
        kept &= ~near | (recording != recording[row])
    return kept if int(kept.sum()) >= settings.LEAST_ROWS else np.ones_like(kept)
