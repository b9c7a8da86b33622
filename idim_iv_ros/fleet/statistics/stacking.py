"""All bags of a robot in one regression, from their R factors, and whether the bags agree.

R factors one below the other have the R factor of all rows: RᵀR = Σ R_rᵀ R_r. With b parameters,
k bags and n rows, one set of parameters for all bags is tested by

    F = ((SSE_pooled − Σ SSE_r) / ((k − 1) b)) / (Σ SSE_r / (n − k b)),

and a group of parameters by giving each bag its own of the group and the others in common.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis
from idim_iv_ros.fleet.regression import stacked
from idim_iv_ros.statistics.hypothesis import HypothesisTest, f_test
from idim_iv_ros.types import FloatArray

NULL = "one set of {what} holds for all bags"
ALL = "all parameters"


@dataclass(frozen=True)
class Regression:
    """Least squares from an R factor.

    Attributes
    ----------
    values : (p,)
    covariance : (p, p)
    squares : float
        Sum of squares that is left.
    dof : int
        Rows less parameters.
    complete : bool
        Whether every parameter is shown; else its values are those of least squares without the
        columns that depend on others, and its covariance says nothing.
    """

    values: FloatArray
    covariance: FloatArray
    squares: float
    dof: int
    complete: bool


def regression(factor: FloatArray, rows: int) -> Regression:
    """Solve for the parameters.

    Parameters
    ----------
    factor : (p + 1, p + 1)
        R factor of the whitened [X y].
    rows
        Behind it.
    """
    width = factor.shape[1] - 1
    basis = independent_basis(factor[:, :width], tolerance=NOT_SHOWN)
    rest = basis.remove(factor[:, -1])
    squares = float(rest @ rest)
    dof = rows - basis.rank
    variance = squares / dof if dof > 0 else np.nan
    root = basis.inverse_root(width)
    return Regression(
        basis.solve(factor[:, -1], width),
        variance * root @ root.T,
        squares,
        dof,
        basis.rank == width and dof > 0,
    )


def shares(factors: Sequence[FloatArray]) -> list[FloatArray]:
    """Matrices W_r (p, p) with which the estimates of the bags make that of all: Σ W_r = 1."""
    width = factors[0].shape[1] - 1
    root = independent_basis(stacked(factors)[:, :width], tolerance=NOT_SHOWN).inverse_root(width)
    inverse = root @ root.T
    return [inverse @ factor[:, :width].T @ factor[:, :width] for factor in factors]


def agreement(
    factors: Sequence[FloatArray],
    rows: Sequence[int],
    groups: Mapping[str, Sequence[int]],
    *,
    alpha: float,
) -> tuple[HypothesisTest, ...]:
    """Test whether one set of parameters holds for all bags, and group by group.

    Parameters
    ----------
    factors, rows
        Of bags that show every parameter.
    groups
        Columns by the name of the group.
    alpha
        Of the test of all parameters; shared among the groups (Bonferroni).
    """
    names = (ALL, *groups)

    def not_run(why: str) -> tuple[HypothesisTest, ...]:
        return tuple(
            HypothesisTest.not_run(NULL.format(what=name), name, why, alpha) for name in names
        )

    count = len(factors)
    width = factors[0].shape[1] - 1 if count else 0
    dof = sum(rows) - count * width
    if count < 2 or dof <= 0:
        return not_run("one bag" if count == 1 else "no bags" if count == 0 else "too few rows")
    separate = sum(float(factor[-1, -1]) ** 2 for factor in factors)
    pooled = float(stacked(factors)[-1, -1]) ** 2
    if separate <= 0.0:
        return not_run("the residual vanishes")
    tests = []
    for name in names:
        columns = list(range(width)) if name == ALL else list(groups[name])
        free = separate if name == ALL else _squares_with_own(factors, columns)
        level = alpha if name == ALL else alpha / max(len(groups), 1)
        tests.append(
            f_test(
                NULL.format(what=name),
                name,
                explained=max(pooled - free, 0.0),
                df=(count - 1) * len(columns),
                unexplained=separate,
                df_denom=dof,
                alpha=level,
            )
        )
    return tuple(tests)


def _squares_with_own(factors: Sequence[FloatArray], columns: Sequence[int]) -> float:
    """Sum of squares left when each bag has its own parameters of these columns."""
    width = factors[0].shape[1]
    others = [k for k in range(width) if k not in set(columns)]
    reduced = []
    for factor in factors:
        ordered = stacked([factor[:, [*columns, *others]]])
        reduced.append(ordered[len(columns) :, len(columns) :])
    return float(stacked(reduced)[-1, -1]) ** 2
