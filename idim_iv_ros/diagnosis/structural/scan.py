"""Score of many candidates beside one fit: what each would take off the whitened residual."""

from collections.abc import Sequence

import numpy as np
import scipy

from idim_iv_ros.diagnosis.structural.likelihood import Columns, Regression, width_of
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, stacked_r_factor
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray

_LEAST_INDEPENDENT = 1e-4  # of a column's energy, that the model leaves
_LARGEST_ENERGY = 1e100
_LEAST_ENERGY = 1e-30  # of a whitened column that is not nothing
# Energy of a direction of a candidate's unit columns, beside the model and the other directions.
_LEAST_DIRECTION = 1e-6
_AT_ONCE = 64  # candidates: their columns stay in the cache


class Scan:
    """Score of candidates with the noise of one fit: what each would take off the residual.

    Thousands of candidates are scored for one that is fitted, so none has a QR of its own. Their
    whitened columns W are projected on the orthonormal columns M R⁻¹ of the model, and what is
    left has the products WᵀW − PᵀP with P = R⁻ᵀMᵀW. Columns of which less than 1e-4 is left are
    out, so that this difference loses at most 4 of 16 digits, whatever the model's conditioning;
    what is left is scaled to unit columns, and its directions below 1e-6 are dropped.
    """

    def __init__(
        self,
        regression: Regression,
        noise_models: Sequence[AutoregressiveModel],
        residuals: Sequence[FloatArray] | None = None,
    ) -> None:
        self._noise_models = noise_models
        self._segments = [rows.segments for rows in regression.joints]
        self._places = [rows.columns for rows in regression.extended]
        self._model = [
            noise.standardized(rows.matrix, rows.segments)
            for rows, noise in zip(regression.extended, noise_models, strict=True)
        ]
        factors = [
            rows.standardized_r_factor(noise)[:, :-1]
            for rows, noise in zip(regression.extended, noise_models, strict=True)
        ]
        factor = stacked_r_factor(factors, self._places, regression.total)
        self._basis = independent_basis(factor, tolerance=NOT_SHOWN)
        self._total = regression.total
        self._residuals = [
            noise.standardized(residual, segments)
            for noise, residual, segments in zip(
                noise_models,
                residuals or [np.zeros(len(rows)) for rows in regression.joints],
                self._segments,
                strict=True,
            )
        ]

    def whiten(self, columns: Columns) -> dict[int, FloatArray]:
        """Whiten a candidate's columns to unit variance of the noise."""
        return {
            joint: self._noise_models[joint].standardized(rows, self._segments[joint])
            for joint, rows in columns.items()
        }

    def normal(self, first: Columns, second: Columns) -> FloatArray:
        """What is left of first' second beside the model; both whitened: (k1, k2)."""
        shared = sorted(set(first) & set(second))
        inner = sum((first[j].T @ second[j] for j in shared), np.zeros((1, 1)))
        return np.asarray(inner - self._projected(first).T @ self._projected(second))

    def energy(self, white: Columns) -> FloatArray:
        """Energy of each whitened column, (k,)."""
        return np.asarray(sum(np.sum(rows**2, axis=0) for rows in white.values()))

    def score(self, columns: Columns) -> tuple[float, FloatArray]:
        """Chi-square that the columns take off the whitened residual, and their coefficients.

        Columns that the model absorbs count for nothing.
        """
        return self.scores([columns])[0]

    def scores(self, candidates: Sequence[Columns]) -> list[tuple[float, FloatArray]]:
        """`score` of many candidates at the same joints, whitened and projected together."""
        found: list[tuple[float, FloatArray]] = [(0.0, np.zeros(0))] * len(candidates)
        widths = [width_of(columns) for columns in candidates]
        for width in sorted(set(widths)):
            equal = [k for k, own in enumerate(widths) if own == width]
            for start in range(0, len(equal), _AT_ONCE):
                which = equal[start : start + _AT_ONCE]
                together = {
                    joint: np.concatenate([candidates[k][joint].T for k in which]).T
                    for joint in candidates[which[0]]
                }
                totals, coefficients = self._scores_of_equal_width(together, width)
                for k, total, own in zip(which, totals, coefficients, strict=True):
                    found[k] = float(total), own
        return found

    def _scores_of_equal_width(self, columns: Columns, width: int) -> tuple[FloatArray, FloatArray]:
        """Scores (m,) and coefficients (m, width) of m candidates side by side."""
        white = self.whiten(columns)
        energy = self.energy(white)
        usual = np.isfinite(energy) & (energy < _LARGEST_ENERGY)
        usual = np.repeat(usual.reshape(-1, width).all(axis=1), width)
        if not usual.all():
            white = {joint: np.where(usual, rows, 0.0) for joint, rows in white.items()}
        right = sum(rows.T @ self._residuals[joint] for joint, rows in white.items())
        left = -_own_products(self._projected(white), width)
        for rows in white.values():
            left += _own_products(rows, width)
        remaining = np.einsum("mii->mi", left)
        least = np.maximum(_LEAST_INDEPENDENT * energy, _LEAST_ENERGY).reshape(-1, width)
        usable = usual.reshape(-1, width) & (remaining > least)
        scale = np.where(usable, 1.0 / np.sqrt(np.where(usable, remaining, 1.0)), 0.0)
        values, vectors = np.linalg.eigh(left * scale[:, :, None] * scale[:, None, :])
        wanted = np.einsum("mik,mi->mk", vectors, scale * np.reshape(right, (-1, width)))
        shown = values > _LEAST_DIRECTION
        weights = np.where(shown, wanted / np.where(shown, values, 1.0), 0.0)
        scores = np.einsum("mk,mk->m", wanted, weights)
        return scores, scale * np.einsum("mik,mk->mi", vectors, weights)

    def _projected(self, white: Columns) -> FloatArray:
        """Coordinates of whitened columns in the model's span, (rank, k)."""
        inner = np.zeros((self._total, width_of(white)))
        for joint, rows in white.items():
            inner[self._places[joint]] += self._model[joint].T @ rows
        return np.asarray(
            scipy.linalg.solve_triangular(self._basis.upper, inner[self._basis.kept], trans="T")
        )


def _own_products(columns: FloatArray, width: int) -> FloatArray:
    """Products of the columns (r, m · width) of each of m candidates: (m, width, width)."""
    lines = np.ascontiguousarray(columns.T)
    lines = lines.reshape(columns.shape[1] // width, width, len(columns))
    return np.asarray(np.matmul(lines, lines.transpose(0, 2, 1)))
