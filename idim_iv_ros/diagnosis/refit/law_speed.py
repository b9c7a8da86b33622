"""The speed that the control law really used, tried on its recorded command.

A drive computes its speed from differences of its encoder, mostly filtered, or has an observer. A
law whose speed is late looks like one with feedforward of the acceleration, of size kd times the
lateness; if one of these speeds explains the command, the law is as configured.

The simulated loop has that speed, too: with kd on an exact one it is damped more, and the
difference in motion looks like elasticity, backlash or a torque that saturates.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.command_rows import (
    CommandRows,
    LawCommands,
    LawSpeed,
    away_from_events,
)
from idim_iv_ros.estimation.instruments import InstrumentSources, SimulatedLoop
from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.simulation import factor_of_lateness

# Share of the newest difference in a first-order filter: from a hardly filtered speed to one that
# is twenty samples late.
FACTORS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05)
_SAME_FACTOR = 0.02  # difference of two filters that makes none for the lag of commands
_CHOICES = 3  # of a speed, at most, as late as the commands are with the one before


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
    plainly = [_JointCommands(commands, *pair, ["kp"]) for pair in usable]

    def scores(
        speeds: Sequence[LawSpeed], joints: Sequence[_JointCommands] = plainly
    ) -> dict[LawSpeed, float]:
        """What speeds leave of the commands: geometric mean over joints.

        Each joint counts by its own noise, as in a likelihood: one whose efforts are much off,
        whatever the speed, would decide in a mean of squares.
        """
        left = np.maximum([joint.left(speeds) for joint in joints], 1e-30)
        means = np.exp(0.5 * np.mean(np.log(left), axis=0))
        return dict(zip(speeds, means.tolist(), strict=True))

    def score(factor: float) -> float:
        speed = LawSpeed("filtered", float(factor))
        return scores([speed])[speed]

    early = [LawSpeed(), LawSpeed("recorded")] if recorded else [LawSpeed()]
    options = scores(early + [LawSpeed("filtered", factor) for factor in FACTORS])
    plain, chosen = options[LawSpeed()], min(options, key=lambda speed: options[speed])
    if chosen.kind == "filtered" and 0 < (place := FACTORS.index(chosen.factor)) < len(FACTORS) - 1:
        bounds = FACTORS[place + 1], FACTORS[place - 1]
        near = scipy.optimize.minimize_scalar(
            score, bounds=bounds, method="bounded", options={"xatol": 1e-3}
        )
        if near.fun < options[chosen]:
            chosen = LawSpeed("filtered", float(near.x))
            options[chosen] = float(near.fun)
    if options[chosen] >= (1.0 - settings.LAW_SPEED_GAIN) * plain:
        return LawSpeed()
    if chosen.kind != "filtered":
        return chosen
    # A feedforward over the acceleration looks like a late speed: beside one, is it still late?
    groups = ["kp", "feedforward_acceleration"]
    left = scores([*early, chosen], [_JointCommands(commands, *pair, groups) for pair in usable])
    best = min(early, key=lambda speed: left[speed])
    return best if left[best] < (1.0 - settings.LAW_SPEED_GAIN) * left[chosen] else chosen


class _JointCommands:
    """Commands of one joint beside its law with other groups, for any speed of it."""

    def __init__(
        self, commands: LawCommands, joint: int, rows: CommandRows, groups: Sequence[str]
    ) -> None:
        self.commands, self.joint, self.rows = commands, joint, rows
        self.gain = float(commands.law.kd[joint])
        others = [rows.groups[name] for name in groups]
        self.plain = np.column_stack([rows.constants, rows.errors[:, 0], *others])
        with_plain_speed = np.column_stack([self.plain, rows.groups["kd"]])
        rest = independent_basis(with_plain_speed).remove(rows.rest)
        self.steady = away_from_events(rest, rows.recording, rows.time)

    def left(self, speeds: Sequence[LawSpeed]) -> list[float]:
        """Share of the energy of the command that the law leaves with each of the speeds."""
        made = []
        for change in self.commands.faster(self.joint, speeds, self.rows.lag):
            matrix = np.column_stack([self.plain, self.rows.groups["kd"] - change])[self.steady]
            rest = (self.rows.rest + self.gain * change)[self.steady]
            energy = float(np.sum(independent_basis(matrix).remove(rest) ** 2))
            made.append(energy / max(len(rest) * self.rows.size**2, 1e-300))
        return made


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
