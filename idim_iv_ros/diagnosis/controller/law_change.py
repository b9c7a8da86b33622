"""What differs in the control law: a comparison of groups of it, beside errors of the recording.

The search is that of the torque. Its rows are recorded less computed commands, its numbers the
errors of the recording with their likely sizes, its candidates the groups of the law.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.compare import Comparison
from idim_iv_ros.diagnosis.comparison.ledger import Ledger
from idim_iv_ros.diagnosis.comparison.model_with_terms import ModelWithTerms, NominalErrors, Term
from idim_iv_ros.diagnosis.comparison.named_columns import (
    NamedColumns,
    ledger_of_rows,
    supported,
)
from idim_iv_ros.diagnosis.comparison.options import Options, whitened
from idim_iv_ros.diagnosis.comparison.refine import together
from idim_iv_ros.diagnosis.comparison.select import select
from idim_iv_ros.diagnosis.refit.law_speed import (
    LawSpeed,
    away_from_events,
    comparable_rows,
    limited,
)
from idim_iv_ros.effects.registry import CONTROL_LAW
from idim_iv_ros.estimation.observation import segments_of
from idim_iv_ros.signals import Motion
from idim_iv_ros.simulation import ControlLaw
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

TIMES = 5  # errors of time: a lag of the effort, position, speed, and the references of both
_UNSURE = 2e-3  # of the commands: noise that rows have at least, or nothing else would be likely
_ROWS = ("rest", "errors", "recording", "time", "second")  # fields with a value for each row
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
        return replace(
            self,
            **{name: getattr(self, name)[kept] for name in _ROWS},
            groups={name: torque[kept] for name, torque in self.groups.items()},
            runs=segments_of([kept[run] for run in self.runs]),
        )

    def followed_by(self, other: "CommandRows") -> "CommandRows":
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
        return ledger_of_rows(rest, self.size, self.errors, likely, self.constants, self.runs)


def command_rows(
    motions: Sequence[Motion], law: ControlLaw, joint: int, speed: LawSpeed, period: float
) -> CommandRows | None:
    """Evaluate the law on the measured motion; None where too few rows are left.

    Parameters
    ----------
    period
        Of the control, s: what the law sees, and is recorded, is about as late.
    """
    tables, recordings, every, times = [], [], [], []
    for number, motion in enumerate(motions):
        signals = motion.signals
        whole = CONTROL_LAW.parts(signals, law, joint, speed.of(signals, joint))
        parts, _ = limited(whole, float(law.torque_limit[joint]), signals.rate)
        recorded = signals.torque[:, joint]
        groups = [parts.groups[name] for name in CONTROL_LAW.groups]
        table = np.column_stack(
            [recorded, recorded - parts.command, -parts.rate, parts.late, *groups]
        )
        kept = comparable_rows(motion, law, joint)
        table = motion.decimation.whole(table[motion.span])[kept]
        tables.append(table)
        recordings.append(np.full(len(table), number))
        times.append(motion.time[kept])
        every.append(kept)
    table = np.concatenate(tables)
    if len(table) < settings.LEAST_ROWS:
        return None
    size = float(np.sqrt(np.mean(table[:, 0] ** 2)))
    least = _UNSURE * size * np.random.default_rng(0).normal(size=len(table))
    step = 1.0 / min(motion.signals.rate for motion in motions)
    return CommandRows(
        rest=table[:, 1] + least,
        size=size,
        groups={name: table[:, 7 + k] for k, name in enumerate(CONTROL_LAW.groups)},
        errors=table[:, 2 : 2 + TIMES],
        likely=np.array([settings.LONGEST_LAG * max(period, step), *[_LATE * period] * 4]),
        runs=segments_of(every),
        recording=np.concatenate(recordings),
        time=np.concatenate(times),
        second=np.zeros(len(table), dtype=bool),
    )


@dataclass(frozen=True)
class LawChange:
    """What differs from the configured law at one joint.

    Attributes
    ----------
    rows : CommandRows
        Without those near an event.
    comparison : Comparison
    terms : tuple of Term
        Groups that differ; of two sets, those of the second one have a scope.
    """

    rows: CommandRows
    comparison: Comparison
    terms: tuple[Term, ...]

    @property
    def errors(self) -> FloatArray:
        """(e,) of the recording."""
        return ModelWithTerms(self.comparison.nominal, self.terms).errors[:TIMES]

    @property
    def lag(self) -> tuple[float, float]:
        """(value, std) of the lag of the effort, s, that all errors of time together make."""
        nominal, model = (
            self.comparison.nominal,
            ModelWithTerms(self.comparison.nominal, self.terms),
        )
        rate = self.rows.errors[:, 0]
        part = np.zeros(len(nominal.root))
        part[:TIMES] = rate @ self.rows.errors / max(float(rate @ rate), 1e-300)
        spread = float(np.sum((part @ nominal.root) ** 2))
        if self.terms:
            moved = np.concatenate([part @ nominal.products_of(term).moved for term in self.terms])
            spread += float(moved @ model.covariance @ moved)
        return float(part @ model.errors), spread**0.5

    @property
    def changes(self) -> dict[str, tuple[float, float]]:
        """(value, std) of each group that differs in all rows."""
        return {
            term.key[0]: (float(term.coefficients[0]), float(term.deviations[0]))
            for term in self.terms
            if term.key[3] is None
        }

    @property
    def statistic(self) -> float:
        """Twice the evidence of the terms."""
        return 2.0 * sum(term.evidence for term in self.terms)

    def left(self, terms: Sequence[Term] = (), lag: float | None = None) -> FloatArray:
        """(r,) what some terms and errors of the recording leave, N m (N).

        Parameters
        ----------
        lag
            That the effort has, s; None: any.
        """
        nominal = self.comparison.nominal
        if lag is not None:
            options = Options(self.rows.ledger(lag), self.comparison.catalogue.candidates)
            white = whitened(options, nominal.white.noise)
            nominal = NominalErrors(options, white, nominal.torques, nominal.errors)
        return ModelWithTerms(nominal, tuple(terms)).residuals(white=False)[0]

    def beyond(self, rows: CommandRows) -> FloatArray:
        """What the commands of all rows (r,) hold beyond the law and its change, N m (N).

        Parameters
        ----------
        rows
            All of the joint, those beside events too.
        """
        rest = rows.rest - rows.errors @ self.errors
        for name, (value, _) in self.changes.items():
            rest = rest - value * rows.groups[name]
        for number in np.unique(rows.recording):
            inside = rows.recording == number
            rest[inside] -= np.median(rest[inside])
        return rest


def law_change(rows: CommandRows) -> LawChange:
    """Search for the groups of the law that explain what the commands have beyond it."""
    # A pulse is plain where the law holds, and where it does not beside what all groups leave.
    for more in ([], [rows.errors, *rows.groups.values()]):
        table = np.column_stack([rows.constants, *more])
        table /= np.maximum(np.linalg.norm(table, axis=0), 1e-300)
        rest = rows.rest - table @ np.linalg.lstsq(table, rows.rest, rcond=1e-9)[0]
        if np.sqrt(np.mean(rest**2)) >= settings.LAW_LEAST_DIFFERENCE * rows.size:
            calm = away_from_events(rest, rows.recording, rows.time)
            if not calm.all():
                rows = rows.only(calm)
                break
    selection = select(NamedColumns(rows.groups, rows.second), rows.ledger())
    terms = supported(selection.comparison, selection.terms, settings.LAW_LEAST_SUPPORT)
    large = [term for term in terms if float(term.whole[0]) >= settings.LAW_LEAST_DIFFERENCE]
    return LawChange(rows, selection.comparison, together(selection.comparison, large))
