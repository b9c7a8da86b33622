"""A search among the named columns of one equation, as that of the torque.

Recorded less computed commands are compared like this, and motors less links of a gear.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis.comparison.candidate import Candidate, Catalogue, Kind, Scope
from idim_iv_ros.diagnosis.comparison.compare import Comparison
from idim_iv_ros.diagnosis.comparison.ledger import Ledger
from idim_iv_ros.diagnosis.comparison.model_with_terms import Term
from idim_iv_ros.effects.effect import Place, Shape
from idim_iv_ros.effects.parametric_effect import ParametricEffect
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.types import BoolArray, FloatArray

FREE = 100.0  # size of what a constant may be, times that of the rows
SECOND: Scope = frozenset({1})  # what differs in a second set of rows
_BLOCKS = 20  # stretches of time by which evidence is judged


class _Named(ParametricEffect):
    """A number that a column belongs to, and the name of the one that it needs."""

    def __init__(self, name: str, acts_with: str) -> None:
        self.name, self.part, self.acts_with = name, name, acts_with  # type: ignore


class NamedColumns(Catalogue):
    """Columns (r,) or (r, w) by name, in all rows and, of two sets, in the second one alone.

    They are free curves besides, so that the first noise is that of what all of them leave.

    `second`: rows (r,) of a second set; columns are (r,) then; `acts_with`: names of those that are
    nothing without another one.
    """

    def __init__(
        self,
        columns: Mapping[str, FloatArray],
        second: BoolArray | None = None,
        acts_with: Mapping[str, str] | None = None,
    ) -> None:
        inside: list[tuple[Scope, BoolArray | float]] = [(frozenset(), 1.0)]
        if second is not None and second.any():
            inside.append((SECOND, second))
        made = []
        for name, values in columns.items():
            effect = _Named(name, (acts_with or {}).get(name, ""))
            for scope, rows in inside:
                lines = np.atleast_2d(values.T) * rows
                if np.std(lines, axis=1).max() <= 1e-12:
                    continue
                for kind in (Kind.NUMBER,) if scope else (Kind.NUMBER, Kind.CURVE):
                    table, shapes = {0: lines.astype(np.float32)}, (Shape(),)
                    width = len(lines)
                    made.append(Candidate(kind, effect, Place(0), shapes, (), table, width, scope))
        self.candidates = tuple(made)

    def why_impossible(self, *_: object) -> str:
        """No coefficient is."""
        return ""


def ledger_of_rows(
    rest: FloatArray,
    size: float,
    numbers: FloatArray,
    likely: FloatArray,
    constants: FloatArray,
    runs: Sequence[slice],
) -> Ledger:
    """Rows of one equation; `runs`: rows without a gap in time.

    `rest`, `size`: (r,) what is to be explained, and the size by which shares of it are taken;
    `numbers`, `likely`: (r, n) columns that the equation has whatever is compared, and how large
    each number is; `constants`: (r, c) columns of numbers that may be of any size.
    """
    matrix = np.column_stack([numbers, constants])
    sizes = np.concatenate([likely, np.full(constants.shape[1], FREE * size)])
    return Ledger(
        joints=(JointRows(matrix, rest, np.arange(matrix.shape[1]), tuple(runs)),),
        gap=(rest,),
        sizes=np.array([size]),
        link_errors=np.diag(sizes),
        drive_errors=np.zeros((matrix.shape[1], 0)),
        free_errors=np.zeros((matrix.shape[1], 0)),
        blocks=(np.arange(len(rest)) * _BLOCKS // len(rest),),
        unsampled=(np.zeros(len(rest)),),
        nominal=False,
    )


def supported(comparison: Comparison, terms: Sequence[Term], least: float) -> tuple[Term, ...]:
    """Leave out, the weakest first, terms that add less evidence than `least` beside the others."""
    terms = tuple(terms)
    while terms:
        others = [(*terms[:k], *terms[k + 1 :]) for k in range(len(terms))]
        whole = comparison.objective(terms)
        losses = [whole - comparison.objective(rest) for rest in others]
        weakest = int(np.argmin(losses))
        if losses[weakest] >= least:
            pairs = zip(terms, losses, strict=True)
            return tuple(replace(term, evidence=loss) for term, loss in pairs)
        terms = others[weakest]
    return ()
