"""The speed that the control law really used, tried on its recorded command.

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
from numpy.typing import NDArray

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.effects.contribution import CommandParts
from idim_iv_ros.effects.registry import CONTROL_LAW
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.estimation.sources import InstrumentSources
from idim_iv_ros.signals import JointSignals, Motion
from idim_iv_ros.signals.motion import all_around
from idim_iv_ros.simulation import ControlLaw, factor_of_lateness
from idim_iv_ros.statistics.residuals import excess_kurtosis
from idim_iv_ros.types import FloatArray

_LIMITED = 0.98  # of the torque limit, from which on a command is limited
_EDGE = 0.5  # of the peak of an event, where it begins and ends
_LEAST_EVENT = 0.1  # of the energy of the largest event, to be listed

# Share of the newest difference in a first-order filter: from a hardly filtered speed to one that
# is twenty samples late.
FACTORS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05)


@dataclass(frozen=True)
class LawSpeed:
    """One way to obtain the speed of a joint.

    Attributes
    ----------
    kind : str
        ``central`` differences of the position (no lateness), the ``recorded`` velocity, or
        backward differences through a first-order filter (``filtered``).
    factor : float
        Of the filter: v[k] = v[k-1] + factor (Δq[k] / Δt − v[k-1]); 1 is no filter.
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
        return (
            "backward differences of the position through a first-order filter of factor "
            f"{self.factor:.2g}"
        )


def law_speed(motions: Sequence[Motion], law: ControlLaw, *, computed: bool = False) -> LawSpeed:
    """Choose the speed of the law, one for all joints and recordings.

    Constants, the gains and a lag of the command are fitted with each, so that another gain does
    not pass for another speed. The plain central difference stays unless another leaves clearly
    less.

    Parameters
    ----------
    computed
        Leave the recorded velocity out: only what can be computed from any position.
    """
    if not law.torque_gains[1].any():
        return LawSpeed()
    recorded = not computed and all(motion.signals.velocity is not None for motion in motions)
    early = [LawSpeed(), LawSpeed("recorded")] if recorded else [LawSpeed()]
    options = early + [LawSpeed("filtered", factor) for factor in FACTORS]
    scores = _scores(motions, law, options)
    best = int(np.argmin(scores))
    chosen, score = options[best], scores[best]
    if chosen.kind == "filtered" and 0 < (place := FACTORS.index(chosen.factor)) < len(FACTORS) - 1:
        near = scipy.optimize.minimize_scalar(
            lambda factor: _scores(motions, law, [LawSpeed("filtered", float(factor))])[0],
            bounds=(FACTORS[place + 1], FACTORS[place - 1]),
            method="bounded",
            options={"xatol": 1e-3},
        )
        if near.fun < score:
            chosen, score = LawSpeed("filtered", float(near.x)), float(near.fun)
    if score >= (1.0 - settings.LAW_SPEED_GAIN) * scores[0]:
        return options[0]
    if chosen.kind != "filtered":
        return chosen
    # A feedforward over the acceleration looks like a late speed: beside one, is it still late?
    *forward, late = _scores(motions, law, [*early, chosen], feedforward=True)
    best = int(np.argmin(forward))
    return early[best] if forward[best] < (1.0 - settings.LAW_SPEED_GAIN) * late else chosen


def with_law_speed(sources: InstrumentSources) -> InstrumentSources:
    """Give the laws of the simulated loop the speed that reproduces the recorded commands.

    The robot has one law: it is compared with the commands of all recordings. Its speed is filtered
    so that it is as late as that of the robot's law; a recorded velocity that the law uses is
    imitated by the filter that reproduces the commands best. Nothing changes where the law is
    fitted (with what the recording holds of the speed), or where no differences of the position
    reproduce the commands better than the plain ones.
    """
    first, *others = sources.sources
    if sources.fits or not isinstance(first, SimulatedLoop):
        return sources
    speed = law_speed(first.motions, first.laws[0], computed=True)
    if speed.kind != "filtered":
        return sources
    laws = []
    for motion, law in zip(first.motions, first.laws, strict=True):
        rate = motion.signals.rate
        period = 1.0 / rate if law.period is None else law.period
        laws.append(replace(law, speed_factor=factor_of_lateness(speed.lateness(rate), period)))
    return replace(sources, sources=(replace(first, laws=tuple(laws)), *others))


def _scores(
    motions: Sequence[Motion],
    law: ControlLaw,
    speeds: Sequence[LawSpeed],
    *,
    feedforward: bool = False,
) -> FloatArray:
    """What each speed leaves of the commands: share of their size, geometric mean over joints.

    Each joint counts by its own noise, as in a likelihood: one whose efforts are much off, whatever
    the speed, would decide in a mean of squares.
    """
    differentiating = np.flatnonzero(np.asarray(law.torque_gains[1]) > 0.0).tolist()
    every = [_shares(motions, law, j, speeds, feedforward=feedforward) for j in differentiating]
    shares = [share for share in every if share is not None]
    if not shares:
        return np.zeros(len(speeds))
    return np.asarray(np.exp(0.5 * np.mean(np.log(np.maximum(shares, 1e-30)), axis=0)))


def _shares(
    motions: Sequence[Motion],
    law: ControlLaw,
    joint: int,
    speeds: Sequence[LawSpeed],
    *,
    feedforward: bool,
) -> FloatArray | None:
    """Share of the energy of one joint's command that the law with each speed leaves.

    `feedforward`: beside one over the acceleration of the reference. None: too few rows.
    """
    plain = LawSpeed()
    gain = float(law.torque_gains[1][joint])
    tables, constants, times = [], [], []
    for number, motion in enumerate(motions):
        signals = motion.signals
        central = plain.of(signals, joint)
        whole = CONTROL_LAW.parts(signals, law, joint, central)
        parts, free = limited(whole, float(law.torque_limit[joint]), signals.rate)
        recorded = signals.torque[:, joint]
        later = [(speed.of(signals, joint) - central) * free for speed in speeds]
        error, slip = parts.groups["kp"], parts.groups["kd"]
        forward = parts.groups["feedforward_acceleration"]
        rest = recorded - parts.command
        table = np.column_stack([recorded, rest, parts.rate, error, slip, forward, *later])
        kept = comparable_rows(motion, law, joint)
        rows = motion.decimation.whole(table[motion.span])[kept]
        tables.append(rows)
        times.append(motion.time[kept])
        constants.append(np.full(len(rows), number))
    table = np.concatenate(tables)
    if len(table) < settings.LEAST_ROWS:
        return None
    which = np.concatenate(constants)
    shared = [2, 3, 5] if feedforward else [2, 3]
    plain_columns = np.column_stack([which[:, None] == np.unique(which), table[:, shared]])
    first = np.column_stack([plain_columns, table[:, 4]])
    rest = table[:, 1] - first @ np.linalg.lstsq(first, table[:, 1])[0]
    steady = away_from_events(rest, which, np.concatenate(times))
    table, plain_columns = table[steady], plain_columns[steady]
    left = []
    for change in table[:, 6:].T:
        matrix = np.column_stack([plain_columns, table[:, 4] - change])
        rest = table[:, 1] + gain * change
        left.append(float(np.sum((rest - matrix @ np.linalg.lstsq(matrix, rest)[0]) ** 2)))
    return np.array(left) / max(float(np.sum(table[:, 0] ** 2)), 1e-300)


def limited(
    parts: CommandParts, limit: float, rate: float
) -> tuple[CommandParts, NDArray[np.bool_]]:
    """Parts of a command at its limit, and where it is free (n_samples,).

    Rows at the limit do not count, but filters carry what a command is beyond it for half a second.
    """
    free = np.abs(parts.command) < limit
    if free.all():
        return parts, free
    command = np.clip(parts.command, -limit, limit)
    groups = {name: torque * free for name, torque in parts.groups.items()}
    slope = np.gradient(command, 1.0 / rate)
    late = parts.late * free[:, None]
    return replace(parts, command=command, rate=slope, late=late, groups=groups), free


def comparable_rows(motion: Motion, law: ControlLaw, joint: int) -> NDArray[np.bool_]:
    """Decimated samples (m,) at which a command is measured and not at the torque limit.

    Nor near a sample of which that is not so, nor near the ends.
    """
    signals = motion.signals
    limit = _LIMITED * float(law.torque_limit[joint])
    good = signals.valid[:, joint] & (np.abs(signals.torque[:, joint]) < limit)
    factor = motion.decimation.factor
    kept = all_around(good[motion.span, None], motion.decimation, factor)[:, 0]
    kept[:2] = kept[-2:] = False
    return np.asarray(kept)


@dataclass(frozen=True)
class LawEvent:
    """A stretch of time in which commands hold something that their law does not.

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


def _in_events(rest: FloatArray) -> NDArray[np.bool_]:
    """Rows (r,) that belong to events; none where what a model leaves acts all the time."""
    if excess_kurtosis(rest) < settings.LAW_EVENT_KURTOSIS:
        return np.zeros(len(rest), dtype=bool)
    size = np.abs(rest)
    return np.asarray(size > settings.LAW_EVENT_SIZE * np.median(size))


def events_in(rest: FloatArray, recording: NDArray[np.int64], time: FloatArray) -> list[LawEvent]:
    """Find the events in what a model leaves, the largest first; none where it acts all the time.

    An event begins and ends where it falls below a share of its own peak: filters smear it, and
    the loop swings after it.

    Parameters
    ----------
    rest, recording, time
        (r,) N m (N); which recording a row belongs to; s.
    """
    large = np.flatnonzero(_in_events(rest))
    if len(large) == 0:
        return []
    apart = np.diff(time[large]) > settings.LAW_EVENTS_APART
    events = []
    for part in np.split(large, np.flatnonzero((np.diff(recording[large]) != 0) | apart) + 1):
        size = np.abs(rest[part])
        core = part[size >= _EDGE * size.max()]
        events.append(
            LawEvent(
                begin=float(time[core[0]]),
                end=float(time[core[-1]]),
                recording=int(recording[core[0]]),
                size=float(np.median(rest[core])),
                energy=float(np.sum(rest[part] ** 2)),
            )
        )
    events.sort(key=lambda event: -event.energy)
    return [event for event in events if event.energy >= _LEAST_EVENT * events[0].energy]


def away_from_events(
    rest: FloatArray, recording: NDArray[np.int64], time: FloatArray
) -> NDArray[np.bool_]:
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
