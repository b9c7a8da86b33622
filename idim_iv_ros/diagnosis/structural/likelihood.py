"""Generalised least squares of the rows of all joints, each with its own autocorrelated noise.

The likelihood is concentrated: coefficients, the variance of each joint's innovations and its
autoregressive model are those that fit best (methods: candidates are compared by how far they
make the residual both small and white).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.estimation.qr import NOT_SHOWN, Basis, independent_basis, stacked_r_factor
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals import AutoregressiveModel, fit_autoregression
from idim_iv_ros.types import FloatArray

Columns = Mapping[int, FloatArray]

_LARGEST_ENERGY = 1e100
_LEAST_ENERGY = 1e-30  # of a whitened column that is not nothing
# Energy of a direction of a candidate's unit columns, beside the model and the other directions.
_LEAST_DIRECTION = 1e-6


@dataclass(frozen=True)
class Fit:
    """Outcome of one fit.

    Attributes
    ----------
    values : (b,)
        Of the model's parameters.
    coefficients : (k,)
        Of the added columns; zero for a column that depends on those before it.
    covariance : (b + k, b + k)
        Zero for such columns.
    noise_models : tuple of AutoregressiveModel
    residuals : one (r_j,) array for each joint, N m, not whitened
    log_likelihood : float
        Concentrated, less one for each coefficient of a noise model (Akaike).
    factor : (≤ b + k + 1, b + k + 1)
        R factor of the whitened [X y].
    """

    values: FloatArray
    coefficients: FloatArray
    covariance: FloatArray
    noise_models: tuple[AutoregressiveModel, ...]
    residuals: tuple[FloatArray, ...]
    log_likelihood: float
    factor: FloatArray

    @property
    def coefficient_covariance(self) -> FloatArray:
        """(k, k) of the added columns."""
        return self.covariance[len(self.values) :, len(self.values) :]


@dataclass(frozen=True, eq=False)
class Regression:
    """Rows of all joints, with columns that were already added.

    Attributes
    ----------
    joints : tuple of JointRows
        Without the added columns.
    parameters : int
        b.
    before : Regression, optional
        The same without the block that was added last.
    block : Columns
        That block: columns by joint (r_j, k); a joint that is missing has zeros.
    """

    joints: tuple[JointRows, ...]
    parameters: int
    before: "Regression | None" = None
    block: Columns | None = None

    def with_columns(self, columns: Columns) -> "Regression":
        """Return the same with one more block."""
        return Regression(self.joints, self.parameters, self, columns)

    @cached_property
    def added(self) -> tuple[Columns, ...]:
        """All blocks of columns that were added."""
        if self.before is None or self.block is None:
            return ()
        return (*self.before.added, self.block)

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """Columns of each block."""
        return tuple(_width(block) for block in self.added)

    @cached_property
    def extended(self) -> tuple[JointRows, ...]:
        """Rows with all added columns; those of a joint that a block leaves alone are shared."""
        if self.before is None or self.block is None:
            return self.joints
        places = np.arange(self.before.total, self.total)
        return tuple(
            rows.beside(self.block[joint], places) if joint in self.block else rows
            for joint, rows in enumerate(self.before.extended)
        )

    @cached_property
    def total(self) -> int:
        """Number of all coefficients: b + k."""
        return self.parameters + sum(self.widths)

    def fit(
        self,
        noise_models: Sequence[AutoregressiveModel] | None = None,
        *,
        steps: int | None = None,
    ) -> Fit:
        """Fit everything by QR; noise models are refined `steps` times from those given.

        Columns of which less than 1e-6 is independent of those before them are left out.
        """
        steps = settings.NOISE_MODEL_STEPS if steps is None else steps
        current = self._first_noise_models() if noise_models is None else tuple(noise_models)
        for step in range(steps + 1):
            factor = stacked_r_factor(
                [
                    rows.standardized_r_factor(noise)
                    for rows, noise in zip(self.extended, current, strict=True)
                ],
                [rows.places for rows in self.extended],
                self.total + 1,
            )
            basis = independent_basis(factor[:, :-1], tolerance=NOT_SHOWN)
            solution = basis.solve(factor[:, -1], self.total)
            residuals = tuple(rows.residual(solution) for rows in self.extended)
            if step < steps:
                current = tuple(
                    noise_model(residual, rows.segments)
                    for residual, rows in zip(residuals, self.joints, strict=True)
                )
        root = basis.inverse_root(self.total)
        return Fit(
            values=solution[: self.parameters],
            coefficients=solution[self.parameters :],
            covariance=root @ root.T,
            noise_models=current,
            residuals=residuals,
            log_likelihood=sum(
                _log_likelihood(residual, rows.segments, noise)
                for residual, rows, noise in zip(residuals, self.joints, current, strict=True)
            ),
            factor=factor,
        )

    def gain_of_last(self, fit: Fit) -> float:
        """Logarithm of the likelihood ratio of the last block, with the noise of `fit` for both.

        `fit` is of this regression. With noise models of its own the model without the block
        would take slow structure for noise: an offset, or gravity, that is left out is
        predictable from its past.
        """
        kept = self.total - self.widths[-1]
        basis = independent_basis(fit.factor[:, :kept], tolerance=NOT_SHOWN)
        without = basis.solve(fit.factor[:, -1], self.total)
        gain = 0.0
        for rows, noise, residual in zip(
            self.extended, fit.noise_models, fit.residuals, strict=True
        ):
            both = np.column_stack([residual, rows.residual(without)])
            energies = np.mean(noise.standardized(both, rows.segments) ** 2, axis=0)
            energies = np.maximum(energies, 1e-300)
            gain += 0.5 * len(residual) * float(np.log(energies[1] / energies[0]))
        return gain

    def scan(self, fit: Fit) -> "Scan":
        """Prepare to try many candidates beside what is in the model now."""
        return Scan(self, fit.noise_models, fit.residuals)

    def _first_noise_models(self) -> tuple[AutoregressiveModel, ...]:
        """White noise, of the size that least squares leaves."""
        residuals = []
        for rows in self.extended:
            basis = independent_basis(rows.r_factor[:, :-1], tolerance=NOT_SHOWN)
            own = basis.solve(rows.r_factor[:, -1], len(rows.columns))
            residuals.append(rows.torque - rows.matrix @ own)
        return white_noise_models(residuals)


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
        self._basis: Basis = independent_basis(factor, tolerance=NOT_SHOWN)
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
        """`score` of many candidates at the same joints, whitened and projected at once."""
        found: list[tuple[float, FloatArray]] = [(0.0, np.zeros(0))] * len(candidates)
        widths = [_width(columns) for columns in candidates]
        for width in set(widths):
            which = [k for k, own in enumerate(widths) if own == width]
            together = {
                joint: np.hstack([candidates[k][joint] for k in which])
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
        projected = _side_by_side(self._projected(white), width)
        left = -np.matmul(projected.transpose(0, 2, 1), projected)
        for rows in white.values():
            blocks = _side_by_side(rows, width)
            left += np.matmul(blocks.transpose(0, 2, 1), blocks)
        remaining = np.einsum("mii->mi", left)
        least = np.maximum(settings.LEAST_INDEPENDENT * energy, _LEAST_ENERGY).reshape(-1, width)
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
        inner = np.zeros((self._total, _width(white)))
        for joint, rows in white.items():
            inner[self._places[joint]] += self._model[joint].T @ rows
        return np.asarray(
            scipy.linalg.solve_triangular(self._basis.upper, inner[self._basis.kept], trans="T")
        )


def white_noise_models(residuals: Sequence[FloatArray]) -> tuple[AutoregressiveModel, ...]:
    """White noise of the size of each joint's residual: weights of the least torque gap."""
    return tuple(
        AutoregressiveModel(np.zeros(0), float(np.var(residual)) or 1.0) for residual in residuals
    )


def noise_model(residual: FloatArray, segments: Sequence[slice]) -> AutoregressiveModel:
    """Autoregressive noise of one joint that believes no frequency to be almost without noise."""
    model = fit_autoregression(residual, segments, max_order=settings.NOISE_MODEL_ORDER)
    model = model.with_white_noise(settings.LEAST_DENSITY)
    variance = float(np.mean(model.whiten(residual, segments) ** 2))
    return replace(model, innovation_variance=variance or 1e-24)


def _log_likelihood(
    residual: FloatArray, segments: Sequence[slice], noise: AutoregressiveModel
) -> float:
    """Of one joint with its own innovations, less the order of its noise model."""
    variance = max(float(np.mean(noise.whiten(residual, segments) ** 2)), 1e-300)
    return float(-0.5 * len(residual) * np.log(variance)) - noise.order


def _width(columns: Columns) -> int:
    return int(next(iter(columns.values())).shape[1])


def _side_by_side(columns: FloatArray, width: int) -> FloatArray:
    """Columns (r, m · width) as one (r, width) matrix for each candidate: (m, r, width)."""
    return columns.reshape(len(columns), -1, width).transpose(1, 0, 2)
