"""All bags of a robot in one regression, from their R factors, and whether the bags agree.

R factors one below the other have the R factor of all rows: RᵀR = Σ R_rᵀ R_r. With b parameters,
k bags and n rows, one set of parameters for all bags is tested by

    F = ((SSE_pooled − Σ SSE_r) / ((k − 1) b)) / (Σ SSE_r / (n − k b)),

and a group of parameters by giving each bag its own of the group and the others in common.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis
from idim_iv_ros.fleet.regression import stacked
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class Regression:
    """Least squares from an R factor.

    `complete` says whether every parameter is shown; else the values are those of least squares
    without the columns that depend on others, and the covariance says nothing.
    """

    values: FloatArray  # (p,)
    covariance: FloatArray  # (p, p)
    squares: float  # sum of squares that is left
    dof: int  # rows less parameters
    complete: bool


def regression(factor: FloatArray, rows: int) -> Regression:
    """Solve for the parameters, from the R factor (p + 1, p + 1) of `rows` whitened rows [X y]."""
    width = factor.shape[1] - 1
    basis = independent_basis(factor[:, :width], tolerance=NOT_SHOWN)
    rest = basis.remove(factor[:, -1])
    squares = float(rest @ rest)
    dof = rows - basis.rank
    variance = squares / dof if dof > 0 else np.nan
    root = basis.inverse_root(width)
    values, complete = basis.solve(factor[:, -1], width), basis.rank == width and dof > 0
    return Regression(values, variance * root @ root.T, squares, dof, complete)


def shares(factors: Sequence[FloatArray]) -> list[FloatArray]:
    """Matrices W_r (p, p) with which the estimates of the bags make that of all: Σ W_r = 1."""
    width = factors[0].shape[1] - 1
    root = independent_basis(stacked(factors)[:, :width], tolerance=NOT_SHOWN).inverse_root(width)
    inverse = root @ root.T
    return [inverse @ factor[:, :width].T @ factor[:, :width] for factor in factors]


def agreement(
    factors: Sequence[FloatArray], rows: Sequence[int], groups: Collection[Sequence[int]]
) -> list[float]:
    """p-value, for each group of columns, of one set of its parameters for all bags.

    The bags show every parameter. NaN for one bag, too few rows, or residuals that vanish.
    """
    count = len(factors)
    width = factors[0].shape[1] - 1 if count else 0
    dof = sum(rows) - count * width
    separate = sum(float(factor[-1, -1]) ** 2 for factor in factors)
    if count < 2 or dof <= 0 or separate <= 0.0:
        return [math.nan] * len(groups)
    pooled = float(stacked(factors)[-1, -1]) ** 2
    p_values = []
    for columns in groups:
        extra = (count - 1) * len(columns)
        gain = max(pooled - _squares_apart(factors, columns), 0.0) / extra
        p_values.append(float(scipy.stats.f.sf(gain / (separate / dof), extra, dof)))
    return p_values


def _squares_apart(factors: Sequence[FloatArray], columns: Sequence[int]) -> float:
    """Sum of squares left when each bag has its own parameters of these columns."""
    others = [k for k in range(factors[0].shape[1]) if k not in set(columns)]
    ordered = [stacked([factor[:, [*columns, *others]]]) for factor in factors]
    reduced = [factor[len(columns) :, len(columns) :] for factor in ordered]
    return float(stacked(reduced)[-1, -1]) ** 2
