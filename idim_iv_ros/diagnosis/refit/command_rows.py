"""Commands of one joint beside its configured law: rows, the speed of the law, and events.

A drive computes its speed from differences of its encoder, mostly filtered, or has an observer. A
law whose speed is late looks like one with feedforward of the acceleration, of size kd times the
lateness; if one of these speeds explains the command, the law is as configured.

The simulated loop has that speed, too: with kd on an exact one it is damped more, and the
difference in motion looks like elasticity, backlash or a torque that saturates.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.effects.contribution import CommandParts
from idim_iv_ros.effects.registry import CONTROL_LAW
from idim_iv_ros.estimation.instruments import InstrumentSources, SimulatedLoop
from idim_iv_ros.estimation.likelihood import rms
from idim_iv_ros.estimation.observation import segments_of
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.signals.filters import shifted
from idim_iv_ros.signals.joint_side import JointSignals
from idim_iv_ros.signals.motion import Motion, all_around
from idim_iv_ros.simulation import ControlLaw, factor_of_lateness
from idim_iv_ros.statistics.residuals import excess_kurtosis
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

TIMES = 5  # errors of time: a lag of the effort, position, speed, and the references of both
_LATE = 0.5  # control periods that what the law sees, and what is recorded, are likely late
_LIMITED = 0.98  # of the torque limit, from which on a command is limited
_EDGE = 0.5  # of the peak of an event, where it begins and ends
_LEAST_EVENT = 0.1  # of the energy of the largest event, to be listed
_LAG_STEPS = 4  # at most, of the search for a lag
_LEAST_STEP = 0.999  # of what is left, which a step must come below
# Share of the newest difference in a first-order filter: from a hardly filtered speed to one that
# is twenty samples late.
_FACTORS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05)
_SAME_FACTOR = 0.02  # difference of two filters that makes none for the lag of commands
_CHOICES = 3  # of a speed, at most, as late as the commands are with the one before


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
        difference = np.diff(position) * signals.rate
        difference = np.concatenate([difference[:1], difference])
        start, part = (1.0 - self.factor) * difference[:1], [1.0, self.factor - 1.0]
        return np.asarray(scipy.signal.lfilter([self.factor], part, difference, zi=start)[0])

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
        through = f" through a first-order filter of factor {self.factor:.2g}"
        return f"backward differences of the position{through if self.factor != 1.0 else ''}"


@dataclass(frozen=True)
class CommandRows:
    """Decimated rows of one joint, without those at the torque limit; (r,) each."""

    rest: FloatArray  # recorded less computed command, N m (N)
    size: float  # RMS of the recorded command, N m (N)
    groups: dict[str, FloatArray]  # torque of a unit of each group that may change
    # (r, e) torque of a unit of what a recording does to commands that are those of the law: a lag
    # of the effort; position, speed and the references of both late, s.
    errors: FloatArray
    likely: FloatArray  # (e,) how large each of these errors is
    runs: tuple[slice, ...]  # rows without a gap in time
    recording: IntArray
    time: FloatArray  # from the start of the recording, s
    second: BoolArray  # rows of a second set of recordings
    lag: float = 0.0  # by which what the law gives is already taken later, s

    @property
    def constants(self) -> FloatArray:
        """(r, recordings)."""
        return np.asarray(self.recording[:, None] == np.unique(self.recording), dtype=float)

    def only(self, kept: BoolArray) -> "CommandRows":
        """Leave out the rows that are not `kept` (r,)."""
        names = ("rest", "errors", "recording", "time", "second")  # a value for each row
        return replace(
            self,
            **{name: getattr(self, name)[kept] for name in names},
            groups={name: torque[kept] for name, torque in self.groups.items()},
            runs=segments_of([kept[run] for run in self.runs]),
        )

    def followed_by(self, other: "CommandRows") -> "CommandRows":
        """Rows of two sets, each with errors of its own."""
        first, groups = len(self.rest), self.groups.items()
        return CommandRows(
            rest=np.concatenate([self.rest, other.rest]),
            size=max(self.size, other.size),
            groups={name: np.concatenate([one, other.groups[name]]) for name, one in groups},
            errors=scipy.linalg.block_diag(self.errors, other.errors),
            likely=np.concatenate([self.likely, other.likely]),
            runs=(*self.runs, *(slice(first + r.start, first + r.stop) for r in other.runs)),
            recording=np.concatenate([self.recording, other.recording + self.recording.max() + 1]),
            time=np.concatenate([self.time, other.time]),
            second=np.repeat([False, True], [first, len(other.rest)]),
        )

    def left_by(self, *columns: FloatArray) -> FloatArray:
        """What constants and more columns (r, …) leave of the rest, (r,) N m (N)."""
        return independent_basis(np.column_stack([self.constants, *columns])).remove(self.rest)


class LawCommands:
    """Recorded commands of all joints beside one law; rows are made once and used again.

    `motions`: filtered, with references; `law`: with the period of the control, s.
    """

    def __init__(self, motions: Sequence[Motion], law: ControlLaw) -> None:
        self.motions, self.law = tuple(motions), law
        # Longest time between two samples of a recording, s; and the period of the control, which
        # is that of the samples unless the law has one.
        self.interval = 1.0 / min(motion.signals.rate for motion in motions)
        self.period = self.interval if law.period is None else law.period
        self._late: dict[tuple[int, LawSpeed], CommandRows | None] = {}

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
            given = np.column_stack([parts.command, -parts.rate, parts.late, *groups])
            if lag != 0.0:
                given = shifted(given, lag, motion.signals.rate)
            table = np.column_stack([recorded, recorded - given[:, 0], given[:, 1:]])
            decimated = motion.decimation.whole(table[motion.span])
            tables.append(np.column_stack([motion.time, decimated])[kept])
        table = np.concatenate(tables)
        first, late = 3 + TIMES, settings.LONGEST_LAG * max(self.period, self.interval)
        return CommandRows(
            rest=table[:, 2],
            size=rms(table[:, 1]),
            groups=dict(zip(CONTROL_LAW.groups, table[:, first:].T, strict=True)),
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
            rows = later = self.rows(joint, speed)
            rest = np.inf
            for _ in range(_LAG_STEPS + 1):
                if later is None:
                    break
                left = rms(later.left_by(later.errors, *later.groups.values()))
                if left >= _LEAST_STEP * rest:
                    break
                rows, rest = later, left
                # The lag that would explain the most alone.
                rate = independent_basis(rows.constants).remove(rows.errors[:, 0])
                step = float(rate @ rows.left_by()) / max(float(rate @ rate), 1e-300)
                later = self.rows(joint, speed, rows.lag + step)
            self._late[joint, speed] = rows
        return self._late[joint, speed]

    def faster(self, joint: int, speeds: Sequence[LawSpeed], lag: float) -> FloatArray:
        """Rows (r, speeds) by which other speeds are above the plain one, where no limit acts.

        `lag`: by which they are taken later, s.
        """
        parts = []
        for motion in self.motions:
            signals, (_, free) = motion.signals, self._evaluated(motion, joint, LawSpeed())
            plain = LawSpeed().of(signals, joint)
            changes = np.stack([(speed.of(signals, joint) - plain) * free for speed in speeds])
            moved = shifted(changes.T, lag, signals.rate)[motion.span]
            parts.append(motion.decimation.whole(moved)[self._comparable(motion, joint)])
        return np.concatenate(parts)

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


def law_speed(commands: LawCommands, *, computed: bool = False) -> LawSpeed:
    """Choose the speed of the law, one for all joints and recordings.

    Constants, the gains and a lag of the command are fitted with each, so that another gain does
    not pass for another speed. The lag is that which the commands have beside the speed of the
    choice before: taken at once with a wrong speed it would keep that one. The plain central
    difference stays unless another leaves clearly less. `computed`: leave the recorded velocity
    out: only what can be computed from any position.
    """
    every = all(motion.signals.velocity is not None for motion in commands.motions)
    chosen = LawSpeed()
    for _ in range(_CHOICES):
        before, chosen = chosen, _chosen(commands, chosen, recorded=every and not computed)
        if chosen.kind == before.kind and abs(chosen.factor - before.factor) < _SAME_FACTOR:
            break
    return chosen


def _chosen(commands: LawCommands, before: LawSpeed, *, recorded: bool) -> LawSpeed:
    """Speed that explains the commands best where they are as late as with the one `before`."""
    usable = []
    for joint in np.flatnonzero(np.asarray(commands.law.kd) > 0.0).tolist():
        rows = commands.late(joint, before)
        if rows is not None and before != LawSpeed():
            rows = commands.rows(joint, LawSpeed(), rows.lag)
        if rows is not None:
            usable.append((joint, rows))
    if not usable:
        return LawSpeed()

    def scores(speeds: Sequence[LawSpeed], *more: str) -> dict[LawSpeed, float]:
        """What speeds leave of the commands: geometric mean over joints.

        Each joint counts by its own noise, as in a likelihood: one whose efforts are much off,
        whatever the speed, would decide in a mean of squares. `more`: groups of the law beside kp.
        """
        logarithms = []
        for joint, rows in usable:
            others = [rows.errors[:, 0], *(rows.groups[name] for name in ("kp", *more))]
            rest = rows.left_by(*others, rows.groups["kd"])
            steady = away_from_events(rest, rows.recording, rows.time)
            table = np.column_stack([rows.constants, *others])[steady]
            kd, gain, left = rows.groups["kd"][steady], float(commands.law.kd[joint]), []
            for change in commands.faster(joint, speeds, rows.lag)[steady].T:
                basis = independent_basis(np.column_stack([table, kd - change]))
                rest = basis.remove(rows.rest[steady] + gain * change)
                left.append(float(np.sum(rest**2)) / max(len(rest) * rows.size**2, 1e-300))
            logarithms.append(np.log(np.maximum(left, 1e-30)))
        return dict(zip(speeds, np.exp(0.5 * np.mean(logarithms, axis=0)).tolist(), strict=True))

    def score(factor: float) -> float:
        """What a filtered speed leaves; kept for the choice that follows."""
        speed = LawSpeed("filtered", float(factor))
        options.update(scores([speed]))
        return options[speed]

    early = [LawSpeed(), LawSpeed("recorded")] if recorded else [LawSpeed()]
    options = scores(early + [LawSpeed("filtered", factor) for factor in _FACTORS])
    chosen = min(options, key=options.__getitem__)
    place = _FACTORS.index(chosen.factor)
    if chosen.kind == "filtered" and 0 < place < len(_FACTORS) - 1:
        bounds = _FACTORS[place + 1], _FACTORS[place - 1]
        scipy.optimize.minimize_scalar(
            score, bounds=bounds, method="bounded", options={"xatol": 1e-3}
        )
        chosen = min(options, key=options.__getitem__)
    if options[chosen] >= (1.0 - settings.LAW_SPEED_GAIN) * options[LawSpeed()]:
        return LawSpeed()
    if chosen.kind != "filtered":
        return chosen
    # A feedforward over the acceleration looks like a late speed: beside one, is it still late?
    left = scores([*early, chosen], "feedforward_acceleration")
    best = min(early, key=left.__getitem__)
    return best if left[best] < (1.0 - settings.LAW_SPEED_GAIN) * left[chosen] else chosen


def with_law_speed(sources: InstrumentSources) -> tuple[InstrumentSources, LawCommands | None]:
    """Give the laws of the simulated loop the speed that reproduces the recorded commands.

    The robot has one law: it is compared with the commands of all recordings, which are returned as
    well. Its speed is filtered so that it is as late as that of the robot's law; a recorded
    velocity that the law uses is imitated by the filter that reproduces the commands best. Nothing
    changes where the law is fitted (with what the recording holds of the speed; there are no
    commands to compare then), or where no differences of the position reproduce the commands better
    than the plain ones.
    """
    first, *others = sources.sources
    if sources.fits or not isinstance(first, SimulatedLoop):
        return sources, None
    commands = LawCommands(first.motions, first.laws[0])
    speed = law_speed(commands, computed=True)
    if speed.kind != "filtered":
        return sources, commands
    laws = []
    for motion, law in zip(first.motions, first.laws, strict=True):
        rate = motion.signals.rate
        period = 1.0 / rate if law.period is None else law.period
        laws.append(replace(law, speed_factor=factor_of_lateness(speed.lateness(rate), period)))
    loop = replace(first, laws=tuple(laws))
    return replace(sources, sources=(loop, *others)), commands


@dataclass(frozen=True)
class LawEvent:
    """A stretch of time in which commands hold something that their law does not."""

    begin: float  # s of the recording
    end: float
    recording: int
    size: float  # median, N m (N)


def events_in(rest: FloatArray, recording: IntArray, time: FloatArray) -> list[LawEvent]:
    """Find the events in what a model leaves, the largest first; none where it acts all the time.

    An event begins and ends where it falls below a share of its own peak: filters smear it, and the
    loop swings after it.

    `rest`, `recording`, `time`: (r,) N m (N); which recording a row belongs to; s.
    """
    large = _in_events(rest)
    if len(large) == 0:
        return []
    apart = np.diff(time[large]) > settings.LAW_EVENTS_APART
    events = []
    for part in np.split(large, np.flatnonzero((np.diff(recording[large]) != 0) | apart) + 1):
        size = np.abs(rest[part])
        core = part[size >= _EDGE * size.max()]
        begin, end = time[core[[0, -1]]].tolist()
        event = LawEvent(begin, end, int(recording[core[0]]), float(np.median(rest[core])))
        events.append((float(np.sum(rest[part] ** 2)), event))
    events.sort(key=lambda pair: -pair[0])
    return [event for energy, event in events if energy >= _LEAST_EVENT * events[0][0]]


def away_from_events(rest: FloatArray, recording: IntArray, time: FloatArray) -> BoolArray:
    """Rows (r,) half a second or more from the events in what the law leaves; all if few remain.

    A pulse in the command pushes the robot, and the law answers: errors follow pulses, so that any
    gain, a lag and a late speed take a part of them. What the law is shows between them.
    Parameters are those of `events_in`.
    """
    kept = np.ones(len(rest), dtype=bool)
    for row in _in_events(rest):
        near = np.abs(time - time[row]) <= settings.LAW_EVENTS_APART
        kept &= ~near | (recording != recording[row])
    return kept if int(kept.sum()) >= settings.LEAST_ROWS else np.ones_like(kept)


def _in_events(rest: FloatArray) -> IntArray:
    """Places of rows in events; none where what a model leaves acts all the time."""
    if excess_kurtosis(rest) < settings.LAW_EVENT_KURTOSIS:
        return np.zeros(0, dtype=np.int64)
    size = np.abs(rest)
    return np.flatnonzero(size > settings.LAW_EVENT_SIZE * np.median(size))
