"""What changed between some recordings and the others: errors of the nominal model cancel.

    y − X β = X_B D_H θ + Φ c + e,   X_B: rows of the second recordings, zero in the others,

β and the coefficients c of accepted effects free and common to all. Without D_H every base
parameter of the second recordings is free; the F test of that against one parameter set for all
(Chow's test, on whitened rows) says whether the recordings agree.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import (
    Accepted,
    ChangeRegression,
    beside,
    change_rows,
    level_axes,
    still_joints,
)
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.parametric_effect import ParameterSpace
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, r_factor
from idim_iv_ros.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class OneSetTest:
    """H0: one set of base parameters holds for the second recordings and the others.

    Attributes
    ----------
    statistic : float
        F.
    df, df_denominator : int
    p_value : float
    before, after : (n_joints,)
        RMS of the residual with one set, and with two, in the second recordings, N m (N): in
        blocks of time that neither was fitted to. A model that misses something fits each
        recording better with parameters of its own, but only the rows that they were fitted to.
    folds_positive : int
        Blocks that two sets predict better.
    sizes : (n_joints,)
        RMS of the recorded torque there, N m (N).
    """

    statistic: float
    df: int
    df_denominator: int
    p_value: float
    before: FloatArray
    after: FloatArray
    folds_positive: int
    sizes: FloatArray

    @property
    def shares(self) -> FloatArray:
        """Torque (n_joints,) that differs there, as a share of the recorded torque, held out."""
        return np.asarray(np.sqrt(np.maximum(self.before**2 - self.after**2, 0.0)) / self.sizes)


@dataclass(frozen=True)
class Contrast:
    """Rows on which the second recordings may differ.

    Attributes
    ----------
    changes : ChangeRegression
        Zero outside the second recordings; the common parameters are among its accepted columns.
    inside : tuple of (r_j,) bool
        Rows of the second recordings.
    free : int
        How many common coefficients are free.
    whitened : tuple of (r_j, free + b + 1)
        Whitened rows of each joint: free columns, base parameters of the second recordings alone,
        and the residual.
    """

    changes: ChangeRegression
    inside: tuple[BoolArray, ...]
    free: int
    whitened: tuple[FloatArray, ...]

    def test(self) -> OneSetTest:
        """Chow's F test of one parameter set for all."""
        whole = self.changes.refit()
        df = max(whole.rank, 1)
        # With no more rows than coefficients nothing is tested: the p-value is then near one.
        rows = max(self.changes.rows - self.free - whole.rank, 1)
        rest = max(self.changes.energy - whole.statistic, 1e-300) / rows
        statistic = whole.statistic / df / rest
        sizes = _rms(
            [torque[each] for torque, each in zip(self.changes.torques, self.inside, strict=True)]
        )
        p_value = float(stats.f.sf(statistic, df, rows))
        before, after, positive = self._held_out()
        return OneSetTest(statistic, df, rows, p_value, before, after, positive, sizes)

    def _held_out(self) -> tuple[FloatArray, FloatArray, int]:
        """RMS in blocks of the second recordings that were not fitted, with one set and two."""
        folds = [
            np.array_split(np.flatnonzero(inside), settings.AGREEMENT_FOLDS)
            for inside in self.inside
        ]
        errors: tuple[list[list[FloatArray]], ...] = ([], [])
        positive = 0
        for number in range(settings.AGREEMENT_FOLDS):
            kept = [
                np.delete(rows, fold[number], axis=0)
                for rows, fold in zip(self.whitened, folds, strict=True)
            ]
            factor = r_factor(np.vstack(kept))
            scores = []
            for kind, width in enumerate((self.free, factor.shape[1] - 1)):
                basis = independent_basis(factor[:, :width], tolerance=NOT_SHOWN)
                solution = basis.solve(factor[:, -1], width)
                parts, score = [], 0.0
                for joint, rows in enumerate(self.whitened):
                    fold = folds[joint][number]
                    score += float(np.sum((rows[fold, -1] - rows[fold, :width] @ solution) ** 2))
                    parts.append(self._error(joint, fold, solution))
                errors[kind].append(parts)
                scores.append(score)
            positive += scores[1] < scores[0]
        rms = [
            _rms([np.concatenate(parts) for parts in zip(*each, strict=True)]) for each in errors
        ]
        return rms[0], rms[1], positive

    def _error(self, joint: int, fold: IntArray, solution: FloatArray) -> FloatArray:
        """Residual of some rows of a joint with these coefficients, N m (N), not whitened."""
        changes = self.changes
        columns = np.hstack([changes.accepted.columns[joint][fold], changes.columns[joint][fold]])
        return np.asarray(changes.residuals[joint][fold] - columns[:, : len(solution)] @ solution)


def _rms(parts: Sequence[FloatArray]) -> FloatArray:
    rms = [float(np.sqrt(np.mean(part**2))) if len(part) else 0.0 for part in parts]
    return np.maximum(rms, 1e-300)


def contrast(
    data: Baseline,
    regression: Regression,
    fit: Fit,
    second: Collection[int],
) -> Contrast:
    """Regress what one parameter set leaves on changes in the second recordings alone.

    Parameters
    ----------
    regression
        With the accepted structural effects as added columns.
    fit
        Of that regression: its noise whitens, and its parameters are those that a gain scales.
    second
        Numbers of the recordings, from 0.
    """
    model = data.prepared.model
    axes = level_axes(np.asarray(model.robot.pinocchio.gravity.linear))
    space = ParameterSpace(model, fit.values, axes, difference=True)
    b, total = regression.parameters, regression.total
    columns, common, residuals, whitened, inside = [], [], [], [], []
    units = change_rows(data, regression, space)
    for joint, (rows, unit) in enumerate(zip(regression.joints, units, strict=True)):
        inside.append(np.isin(data.recordings[joint], list(second)))
        unit[~inside[-1]] = 0.0
        extended = regression.extended[joint]
        free = np.zeros((len(rows), total))
        free[:, extended.columns] = extended.matrix
        residual = rows.torque - free[:, :b] @ fit.values
        table = np.column_stack([free, unit, residual])
        whitened.append(fit.noise_models[joint].standardized(table, rows.segments))
        columns.append(unit)
        common.append(free)
        residuals.append(residual)
    factor, moved = beside(np.vstack(whitened), total)
    kept = [*range(total + b), total + space.size]
    changes = ChangeRegression(
        space,
        factor[:, :-1],
        factor[:, -1],
        tuple(columns),
        tuple(residuals),
        tuple(rows.torque for rows in regression.joints),
        Accepted(tuple(common), moved[:, -1], moved[:, :-1]),
        still_joints(data),
    )
    return Contrast(changes, tuple(inside), total, tuple(rows[:, kept] for rows in whitened))


def with_own_parameters(
    data: Baseline, regression: Regression, second: Collection[int]
) -> Regression:
    """Add base parameters of their own for the second recordings, as columns."""
    columns = {}
    for joint, rows in enumerate(regression.joints):
        own = np.zeros((len(rows), regression.parameters))
        own[:, rows.columns] = rows.matrix
        own[~np.isin(data.recordings[joint], list(second))] = 0.0
        columns[joint] = own
    return regression.with_columns(columns)
