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
from idim_iv_ros.diagnosis.refit.law_event import beside_no_event
from idim_iv_ros.effects.contribution import CommandParts
from idim_iv_ros.effects.registry import CONTROL_LAW
from idim_iv_ros.estimation.instruments import SimulatedLoop
from idim_iv_ros.estimation.sources import InstrumentSources
from idim_iv_ros.signals import JointSignals, Motion
from idim_iv_ros.signals.motion import all_around
from idim_iv_ros.simulation import ControlLaw, factor_of_lateness
from idim_iv_ros.types import FloatArray

_LIMITED = 0.98  # of the torque limit, from which on a command is limited

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


def law_speeds(recorded: bool) -> tuple[LawSpeed, ...]:
    """Ways to try, the plain one first; `recorded`: whether all recordings hold velocities."""
    first = (LawSpeed(), *((LawSpeed("recorded"),) if recorded else ()))
    return (*first, *(LawSpeed("filtered", factor) for factor in FACTORS))


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
    options = law_speeds(recorded)
    scores = _scores(motions, law, options)
    best = int(np.argmin(scores))
    chosen, score = options[best], scores[best]
    if chosen.kind == "filtered" and 0 < (place := FACTORS.index(chosen.factor)) < len(FACTORS) - 1:
        found = scipy.optimize.minimize_scalar(
            lambda factor: _scores(motions, law, [LawSpeed("filtered", float(factor))])[0],
            bounds=(FACTORS[place + 1], FACTORS[place - 1]),
            method="bounded",
            options={"xatol": 1e-3},
        )
        if found.fun < score:
            chosen, score = LawSpeed("filtered", float(found.x)), float(found.fun)
    if score >= (1.0 - settings.LAW_SPEED_GAIN) * scores[0]:
        return options[0]
    if chosen.kind != "filtered":
        return chosen
    # A feedforward over the acceleration looks like a late speed: beside one, is it still late?
    early = law_speeds(recorded)[: 2 if recorded else 1]
    *forward, late = _scores(motions, law, [*early, chosen], feedforward=True)
    best = int(np.argmin(forward))
    return early[best] if forward[best] < (1.0 - settings.LAW_SPEED_GAIN) * late else chosen


def with_law_speed(sources: InstrumentSources) -> InstrumentSources:
    """Give the laws of the simulated loop the speed that reproduces the recorded commands.

    Nothing changes where the law is fitted (with what the recording holds of the speed), or where
    no differences of the position reproduce the commands better than the plain ones.
    """
    first, *others = sources.sources
    if sources.fits or not isinstance(first, SimulatedLoop):
        return sources
    laws = laws_with_speed(first.motions, first.laws)
    return replace(sources, sources=(replace(first, laws=laws), *others))


def laws_with_speed(
    motions: Sequence[Motion], laws: Sequence[ControlLaw]
) -> tuple[ControlLaw, ...]:
    """Filter the speed of each recording's law so that it is as late as that of the robot's law.

    The robot has one law: it is compared with the commands of all recordings. A recorded velocity
    that the law uses is imitated by the filter that reproduces the commands best.
    """
    speed = law_speed(motions, laws[0], computed=True)
    if speed.kind != "filtered":
        return tuple(laws)
    made = []
    for motion, law in zip(motions, laws, strict=True):
        rate = motion.signals.rate
        period = 1.0 / rate if law.period is None else law.period
        made.append(replace(law, speed_factor=factor_of_lateness(speed.lateness(rate), period)))
    return tuple(made)


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
    joints = [joint for joint in range(len(law.kp)) if law.torque_gains[1][joint] > 0.0]
    shares = [
        share
        for joint in joints
        if (share := _shares(motions, law, joint, speeds, feedforward=feedforward)) is not None
    ]
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

    With a feedforward over the acceleration of the reference beside it, where that is asked for.
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
    known = [2, 3, 5] if feedforward else [2, 3]
    plain_columns = np.column_stack([which[:, None] == np.unique(which), table[:, known]])
    first = np.column_stack([plain_columns, table[:, 4]])
    rest = table[:, 1] - first @ np.linalg.lstsq(first, table[:, 1])[0]
    steady = beside_no_event(rest, which, np.concatenate(times))
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
    """Decimated samples (m,) at which a command is measured and not at the torque limit."""
    signals = motion.signals
    limit = _LIMITED * float(law.torque_limit[joint])
    bad = ~signals.valid[:, joint] | (np.abs(signals.torque[:, joint]) >= limit)
    return _apart(bad[motion.span], motion)


def _apart(bad: NDArray[np.bool_], motion: Motion) -> NDArray[np.bool_]:
    """Decimated samples without a bad one near them, nor near the ends."""
    kept = all_around(~bad[:, None], motion.decimation, motion.decimation.factor)[:, 0]
    kept[:2] = kept[-2:] = False
    return np.asarray(kept)
