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

from idim_iv_ros.diagnosis.parametric.change_regression import (
    Accepted,
    ChangeRegression,
    change_rows,
    level_axes,
    projected,
    still_joints,
)
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.parametric_effect import ParameterSpace
from idim_iv_ros.types import BoolArray, FloatArray


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
        RMS of the residual with one set, and with two, in the second recordings, N m (N).
    sizes : (n_joints,)
        RMS of the recorded torque there, N m (N).
    """

    statistic: float
    df: int
    df_denominator: int
    p_value: float
    before: FloatArray
    after: FloatArray
    sizes: FloatArray

    @property
    def shares(self) -> FloatArray:
        """Torque (n_joints,) that differs there, as a share of the recorded torque."""
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
    """

    changes: ChangeRegression
    inside: tuple[BoolArray, ...]
    free: int

    def test(self) -> OneSetTest:
        """Chow's F test of one parameter set for all."""
        whole = self.changes.refit()
        df = max(whole.rank, 1)
        rows = self.changes.rows - self.free - whole.rank
        rest = max(self.changes.energy - whole.statistic, 1e-300) / rows
        statistic = whole.statistic / df / rest
        before = self.rms(np.zeros(self.changes.space.size))
        after = self.rms(whole.contributions.sum(axis=1))
        sizes = self._rms(self.changes.torques)
        p_value = float(stats.f.sf(statistic, df, rows))
        return OneSetTest(statistic, df, rows, p_value, before, after, sizes)

    def rms(self, contribution: FloatArray) -> FloatArray:
        """RMS (n_joints,) of the second recordings' residual with a change (d,), N m (N)."""
        changes = self.changes
        common = changes.accepted.torques(contribution)
        return self._rms(
            [
                residual - columns @ contribution - torque
                for residual, columns, torque in zip(
                    changes.residuals, changes.columns, common, strict=True
                )
            ]
        )

    def _rms(self, rows: Sequence[FloatArray]) -> FloatArray:
        parts = [each[inside] for each, inside in zip(rows, self.inside, strict=True)]
        rms = [float(np.sqrt(np.mean(part**2))) if len(part) else 0.0 for part in parts]
        return np.maximum(rms, 1e-300)


def contrast(
    data: Baseline,
    regression: Regression,
    fit: Fit,
    second: Collection[int],
    *,
    apart: Sequence[Collection[int]] = (),
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
    apart
        Sets of other recordings that have parameters of their own in any case.
    """
    model = data.prepared.model
    axes = level_axes(np.asarray(model.robot.pinocchio.gravity.linear))
    space = ParameterSpace(model, fit.values, axes, difference=True)
    b, total = regression.parameters, regression.total
    width = total + b * len(apart)
    columns, common, residuals, whitened, inside = [], [], [], [], []
    for joint, rows in enumerate(regression.joints):
        unit = change_rows(data, regression, space, joint)
        inside.append(np.isin(data.recordings[joint], list(second)))
        unit[~inside[-1]] = 0.0
        wide, places = regression.wide(joint)
        free = np.zeros((len(rows.torque), width))
        free[:, places] = wide
        residual = rows.torque - free[:, :b] @ fit.values
        for number, other in enumerate(apart):
            own = np.isin(data.recordings[joint], list(other))
            free[own, total + b * number : total + b * (number + 1)] = free[own, :b]
        whitened.append(
            fit.noise_models[joint].apply(np.column_stack([free, unit, residual]), rows.runs)
        )
        columns.append(unit)
        common.append(free)
        residuals.append(residual)
    triangle, moved = projected(np.vstack(whitened), width)
    changes = ChangeRegression(
        space,
        triangle[:, :-1],
        triangle[:, -1],
        tuple(columns),
        tuple(residuals),
        tuple(rows.torque for rows in regression.joints),
        Accepted(tuple(common), moved[:, -1], moved[:, :-1]),
        still_joints(data),
    )
    return Contrast(changes, tuple(inside), width)
