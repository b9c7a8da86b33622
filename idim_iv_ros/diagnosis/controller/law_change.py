"""What differs in the control law: a comparison of groups of it, beside errors of the recording.

The search is that of the torque. Its rows are recorded less computed commands, its numbers the
errors of the recording with their likely sizes, its candidates the groups of the law.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.beside import Beside, NominalErrors, Term
from idim_iv_ros.diagnosis.comparison.candidate import Candidate, Catalogue, Kind, Scope
from idim_iv_ros.diagnosis.comparison.compare import Comparison
from idim_iv_ros.diagnosis.comparison.options import Options, whitened
from idim_iv_ros.diagnosis.comparison.refine import together
from idim_iv_ros.diagnosis.comparison.select import select
from idim_iv_ros.diagnosis.comparison.signals import SignalError
from idim_iv_ros.diagnosis.controller.command_rows import TIMES, CommandRows
from idim_iv_ros.diagnosis.controller.law_event import beside_no_event
from idim_iv_ros.effects.effect import Place, Shape
from idim_iv_ros.effects.motion import RobotMotion
from idim_iv_ros.types import FloatArray

_SECOND: Scope = frozenset({1})  # what differs in the second set


class _Group(SignalError):
    """One group of the law at one joint; its columns are the rows' own."""

    def __init__(self, name: str) -> None:
        self.name = name  # type: ignore[misc]

    def places(self, joints: int) -> list[Place]:
        return [Place(0)]

    def admissible(self, shape: Shape, coefficients: FloatArray) -> bool:
        return True

    def columns(self, motion: RobotMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        raise NotImplementedError


class _Groups(Catalogue):
    """Groups that vary, in all rows and, of two sets, in the second one alone.

    They are free curves besides, so that the first noise is that of what all of them leave.
    """

    def __init__(self, rows: CommandRows) -> None:
        made = []
        for name, torque in rows.groups.items():
            for scope in (None, _SECOND) if rows.second.any() else (None,):
                inside = torque if scope is None else torque * rows.second
                if np.std(inside) <= 1e-12:
                    continue
                lines = {0: inside[None].astype(np.float32)}
                kinds = (Kind.NUMBER, Kind.CURVE) if scope is None else (Kind.NUMBER,)
                made += [
                    Candidate(kind, _Group(name), Place(0), (Shape(),), (), lines, 1, scope)
                    for kind in kinds
                ]
        self.candidates = tuple(made)

    def why_impossible(self, *_: object) -> str:
        """No change of a gain is."""
        return ""


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
        return Beside(self.comparison.nominal, self.terms).errors[:TIMES]

    @property
    def lag(self) -> tuple[float, float]:
        """(value, std) of the lag of the effort, s, that all errors of time together make."""
        nominal, model = self.comparison.nominal, Beside(self.comparison.nominal, self.terms)
        rate = self.rows.errors[:, 0]
        part = np.zeros(len(nominal.root))
        part[:TIMES] = rate @ self.rows.errors / max(float(rate @ rate), 1e-300)
        spread = float(np.sum((part @ nominal.root) ** 2))
        if self.terms:
            moved = np.concatenate([part @ nominal.link(term).moved for term in self.terms])
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
        return Beside(nominal, tuple(terms)).residuals(white=False)[0]

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
            own = rows.recording == number
            rest[own] -= np.median(rest[own])
        return rest


def law_change(rows: CommandRows) -> LawChange:
    """Search for the groups of the law that explain what the commands have beyond it."""
    # A pulse is plain where the law holds, and where it does not beside what all groups leave.
    for more in ([], [rows.errors, *rows.groups.values()]):
        table = np.column_stack([rows.constants, *more])
        table /= np.maximum(np.linalg.norm(table, axis=0), 1e-300)
        rest = rows.rest - table @ np.linalg.lstsq(table, rows.rest, rcond=1e-9)[0]
        if np.sqrt(np.mean(rest**2)) >= settings.LAW_LEAST_DIFFERENCE * rows.size:
            calm = beside_no_event(rest, rows.recording, rows.time)
            if not calm.all():
                rows = rows.only(calm)
                break
    selection = select(_Groups(rows), rows.ledger())
    kept = [
        term
        for term in selection.terms
        if float(term.whole[0]) >= settings.LAW_LEAST_DIFFERENCE
        and term.evidence >= settings.LAW_LEAST_SUPPORT
    ]
    return LawChange(rows, selection.comparison, together(selection.comparison, kept))
