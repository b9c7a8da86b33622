"""Recorded less computed commands of one joint, and what may make them differ."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.ledger import Ledger
from idim_iv_ros.diagnosis.controller.law_speed import LawSpeed, comparable_rows, limited
from idim_iv_ros.effects.controller_mismatch import GROUPS, ControllerMismatch
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import ControlLaw
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_BLOCKS = 20  # stretches of time by which a change of the law is judged
TIMES = 5  # errors of time: a lag of the effort, position, speed, and the references of both
_UNSURE = 2e-3  # of the commands: noise that rows have at least, or nothing else would be likely
_FREE = 100.0  # torque that a constant may have, times that of the commands
_LATE = 0.5  # control periods that what the law sees, and what is recorded, are likely late


@dataclass(frozen=True)
class CommandRows:
    """Decimated rows of one joint, without those at the torque limit; (r,) each.

    Attributes
    ----------
    rest : N m (N)
        Recorded less computed command.
    size : float
        RMS of the recorded command, N m (N).
    groups : dict
        Torque of a unit of each group that may change.
    errors : (r, e)
        Torque of a unit of what a recording does to commands that are those of the law: a lag of
        the effort; position, speed and the references of both late, s.
    likely : (e,)
        How large each of them is.
    runs : tuple of slice
        Rows without a gap in time.
    recording : (r,) int
        Which recording each row belongs to.
    time : s
        From the start of the recording.
    second : (r,) bool
        Rows of a second set of recordings.
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

    @property
    def constants(self) -> FloatArray:
        """(r, recordings)."""
        return np.asarray(self.recording[:, None] == np.unique(self.recording), dtype=float)

    def only(self, kept: BoolArray) -> "CommandRows":
        """Leave out the rows that are not `kept` (r,)."""
        runs, start = [], 0
        for run in self.runs:
            runs += [slice(start + first, start + last) for first, last in _stretches(kept[run])]
            start += int(kept[run].sum())
        return replace(
            self,
            rest=self.rest[kept],
            groups={name: torque[kept] for name, torque in self.groups.items()},
            errors=self.errors[kept],
            runs=tuple(runs),
            recording=self.recording[kept],
            time=self.time[kept],
            second=self.second[kept],
        )

    def above(self, other: "CommandRows") -> "CommandRows":
        """Rows of two sets, each with errors of its own."""
        first = len(self.rest)
        return CommandRows(
            rest=np.concatenate([self.rest, other.rest]),
            size=max(self.size, other.size),
            groups={
                name: np.concatenate([torque, other.groups[name]])
                for name, torque in self.groups.items()
            },
            errors=scipy.linalg.block_diag(self.errors, other.errors),
            likely=np.concatenate([self.likely, other.likely]),
            runs=(*self.runs, *(slice(first + r.start, first + r.stop) for r in other.runs)),
            recording=np.concatenate([self.recording, other.recording + self.recording.max() + 1]),
            time=np.concatenate([self.time, other.time]),
            second=np.repeat([False, True], [first, len(other.rest)]),
        )

    def ledger(self, lag: float | None = None) -> Ledger:
        """Rows of the comparison: its numbers are the errors, and then the constants.

        Parameters
        ----------
        lag
            Of the effort, s; None: any. With a lag, all else is on time.
        """
        rest, likely = self.rest, self.likely.copy()
        if lag is not None:
            rest, likely[:TIMES] = rest - lag * self.errors[:, 0], 0.0
        matrix = np.column_stack([self.errors, self.constants])
        free = np.full(self.constants.shape[1], _FREE * self.size)
        joint = JointRows(matrix, rest, np.arange(matrix.shape[1]), self.runs)
        return Ledger(
            joints=(joint,),
            gap=(rest,),
            sizes=np.array([self.size]),
            link_errors=np.diag(np.concatenate([likely, free])),
            drive_errors=np.zeros((matrix.shape[1], 0)),
            blocks=(np.arange(len(rest)) * _BLOCKS // len(rest),),
            nominal=False,
        )


def command_rows(
    motions: Sequence[Motion], law: ControlLaw, joint: int, speed: LawSpeed, period: float
) -> CommandRows | None:
    """Evaluate the law on the measured motion; None where too few rows are left.

    Parameters
    ----------
    period
        Of the control, s: what the law sees, and is recorded, is about as late.
    """
    tables, recordings, runs, times, start = [], [], [], [], 0
    for number, motion in enumerate(motions):
        signals = motion.signals
        whole = ControllerMismatch().parts(signals, law, joint, speed.of(signals, joint))
        parts, _ = limited(whole, float(law.torque_limit[joint]), signals.rate)
        recorded = signals.torque[:, joint]
        groups = [parts.groups[name] for name in GROUPS]
        table = np.column_stack(
            [recorded, recorded - parts.command, -parts.rate, parts.late, *groups]
        )
        kept = comparable_rows(motion, law, joint)
        table = motion.decimation.whole(table[motion.span])[kept]
        tables.append(table)
        recordings.append(np.full(len(table), number))
        times.append(motion.time[kept])
        runs += [slice(start + first, start + last) for first, last in _stretches(kept)]
        start += len(table)
    if start < settings.LEAST_ROWS:
        return None
    table = np.concatenate(tables)
    size = float(np.sqrt(np.mean(table[:, 0] ** 2)))
    least = _UNSURE * size * np.random.default_rng(0).normal(size=start)
    step = 1.0 / min(motion.signals.rate for motion in motions)
    return CommandRows(
        rest=table[:, 1] + least,
        size=size,
        groups={name: table[:, 7 + k] for k, name in enumerate(GROUPS)},
        errors=table[:, 2 : 2 + TIMES],
        likely=np.array([settings.LONGEST_LAG * max(period, step), *[_LATE * period] * 4]),
        runs=tuple(runs),
        recording=np.concatenate(recordings),
        time=np.concatenate(times),
        second=np.zeros(len(table), dtype=bool),
    )


def _stretches(kept: BoolArray) -> list[tuple[int, int]]:
    """Stretches of rows without a gap, counted among those that are kept."""
    places = np.flatnonzero(kept)
    if len(places) == 0:
        return []
    cuts = np.flatnonzero(np.diff(places) > 1) + 1
    return list(pairwise([0, *cuts.tolist(), len(places)]))
