"""What changed between some recordings and the others: errors of the nominal model cancel.

    y − X β = X_B D_H θ + Φ c + e,   X_B: rows of the second recordings, zero in the others,

β and the coefficients c of accepted effects free and common to all. Without D_H every base
parameter of the second recordings is free; the F test of that against one parameter set for all
(Chow's test, on whitened rows) says whether the recordings agree.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.parametric.change_regression import (
    ChangeRegression,
    change_rows,
    level_axes,
    reduced,
    still_joints,
)
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Fit, Regression
from idim_iv_ros.effects.parametric_effect import ParameterSpace
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, r_factor
from idim_iv_ros.statistics.hypothesis import HypothesisTest, f_test
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_NULL = "one set of base parameters holds for this recording and the others"


@dataclass(frozen=True)
class OneSetTest:
    """Whether one set of base parameters holds for the second recordings and the others.

    Attributes
    ----------
    hypothesis : HypothesisTest
        Chow's F test.
    before, after : (n_joints,)
        RMS of the residual with one set, and with two, in the second recordings, N m (N): in
        blocks of time that neither was fitted to. A model that misses something fits each
        recording better with parameters of its own, but only the rows that they were fitted to.
    folds_positive : int
        Blocks that two sets predict better.
    sizes : (n_joints,)
        RMS of the recorded torque there, N m (N).
    """

    hypothesis: HypothesisTest
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
    whitened : tuple of (r_j, a + b + 1)
        Whitened rows of each joint: free columns, base parameters of the second recordings alone,
        and the residual.
    """

    changes: ChangeRegression
    inside: tuple[BoolArray, ...]
    whitened: tuple[FloatArray, ...]

    def test(self, alpha: float, null: str = _NULL) -> OneSetTest:
        """Test one parameter set for all at the level `alpha`; `null`: H0 in words."""
        changes = self.changes
        whole = changes.refit()
        left = changes.rows - self._free - whole.rank
        hypothesis = HypothesisTest.not_run(null, "all", "too few rows", alpha)
        if left > 0 and whole.rank > 0:
            hypothesis = f_test(
                null,
                "all",
                explained=whole.statistic,
                df=whole.rank,
                unexplained=max(changes.energy - whole.statistic, 1e-300),
                df_denom=left,
                alpha=alpha,
            )
        sizes = _rms(
            [torque[each] for torque, each in zip(changes.torques, self.inside, strict=True)]
        )
        before, after, positive = self._held_out()
        return OneSetTest(hypothesis, before, after, positive, sizes)

    @property
    def _free(self) -> int:
        """How many common coefficients are free."""
        return int(self.changes.accepted.columns[0].shape[1])

    def _held_out(self) -> tuple[FloatArray, FloatArray, int]:
        """RMS in blocks of the second recordings that were not fitted, with one set and two."""
        count = settings.AGREEMENT_FOLDS
        folds = [np.array_split(np.flatnonzero(inside), count) for inside in self.inside]
        errors: tuple[list[list[FloatArray]], ...] = ([], [])
        positive = 0
        for fold in zip(*folds, strict=True):
            kept = [
                np.delete(rows, out, axis=0) for rows, out in zip(self.whitened, fold, strict=True)
            ]
            factor = r_factor(np.vstack(kept))
            scores = []
            for kind, width in enumerate((self._free, factor.shape[1] - 1)):
                basis = independent_basis(factor[:, :width], tolerance=NOT_SHOWN)
                solution = basis.solve(factor[:, -1], width)
                scores.append(
                    sum(
                        float(np.sum((rows[out, -1] - rows[out, :width] @ solution) ** 2))
                        for rows, out in zip(self.whitened, fold, strict=True)
                    )
                )
                errors[kind].append(
                    [self._error(joint, out, solution) for joint, out in enumerate(fold)]
                )
            positive += scores[1] < scores[0]
        before, after = (
            _rms([np.concatenate(parts) for parts in zip(*each, strict=True)]) for each in errors
        )
        return before, after, positive

    def _error(self, joint: int, rows: IntArray, solution: FloatArray) -> FloatArray:
        """Residual of some rows of a joint with these coefficients, N m (N), not whitened."""
        changes = self.changes
        columns = np.hstack([changes.accepted.columns[joint][rows], changes.columns[joint][rows]])
        return np.asarray(changes.residuals[joint][rows] - columns[:, : len(solution)] @ solution)


def _rms(parts: Sequence[FloatArray]) -> FloatArray:
    rms = [float(np.sqrt(np.mean(part**2))) if len(part) else 0.0 for part in parts]
    return np.maximum(rms, 1e-300)


class PooledRows:
    """Rows of all recordings with one parameter set, from which contrasts are made.

    They are whitened once: filters end with each recording, so that rows of one recording may be
    taken out afterwards.

    Parameters
    ----------
    regression
        With the accepted structural effects as added columns.
    fit
        Of that regression: its noise whitens, and its parameters are those that a gain scales.
    """

    def __init__(self, data: Baseline, regression: Regression, fit: Fit) -> None:
        model = data.prepared.model
        axes = level_axes(np.asarray(model.robot.pinocchio.gravity.linear))
        self._recordings = data.recordings
        self._still = still_joints(data)
        self._space = ParameterSpace(model, fit.values, axes, difference=True)
        self._torques = [rows.torque for rows in regression.joints]
        self._residuals = [rows.residual(fit.values) for rows in regression.joints]
        self._units = change_rows(data, regression, self._space)
        self._free = []
        self._whitened = []
        for joint, rows in enumerate(regression.extended):
            free = np.zeros((len(rows), regression.total))
            free[:, rows.columns] = rows.matrix
            table = np.column_stack([free, self._units[joint], self._residuals[joint]])
            self._free.append(free)
            self._whitened.append(fit.noise_models[joint].standardized(table, rows.segments))

    def contrast(self, second: Collection[int]) -> Contrast:
        """Regress what one parameter set leaves on changes in the second recordings alone.

        Parameters
        ----------
        second
            Numbers of the recordings, from 0.
        """
        space, free = self._space, self._free[0].shape[1]
        inside = tuple(np.isin(each, list(second)) for each in self._recordings)
        columns, whitened = [], []
        for own, unit, table in zip(inside, self._units, self._whitened, strict=True):
            columns.append(np.where(own[:, None], unit, 0.0))
            rows = table.copy()
            rows[~own, free : free + space.size] = 0.0
            whitened.append(rows)
        changes = reduced(
            space, whitened, columns, self._residuals, self._torques, self._free, self._still
        )
        kept = [*range(free + len(space.given)), free + space.size]
        return Contrast(changes, inside, tuple(rows[:, kept] for rows in whitened))


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
