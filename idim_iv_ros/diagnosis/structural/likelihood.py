"""Generalised least squares of the rows of all joints, each with its own coloured noise.

The likelihood is concentrated: coefficients, the variance of each joint's innovations and its
autoregressive colour are those that fit best (methods: candidates are compared by how far they
make the residual both small and white).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.signals import AutoregressiveModel, fit_autoregression
from idim_iv_ros.types import FloatArray, IntArray

Columns = Mapping[int, FloatArray]

_LARGEST_ENERGY = 1e100
_LEAST_ENERGY = 1e-30  # of a whitened column that is not nothing
_RIDGE = 1e-10  # of a column's energy: keeps columns that depend on others from blowing up


@dataclass(frozen=True)
class JointData:
    """One joint's rows.

    Attributes
    ----------
    torque : (r,) N m (N)
    matrix : (r, c)
        Regressor of the smooth motion; only the columns below.
    columns : (c,) int
        Their places among all b parameters.
    runs : tuple of slice
        Rows that are contiguous in time.
    """

    torque: FloatArray
    matrix: FloatArray
    columns: IntArray
    runs: tuple[slice, ...]


@dataclass(frozen=True)
class NoiseModel:
    """Noise of one joint: its autoregressive model, and the innovations' standard deviation."""

    model: AutoregressiveModel
    sigma: float

    def apply(self, rows: FloatArray, runs: Sequence[slice]) -> FloatArray:
        """Whiten rows (r, …) to unit variance."""
        return self.model.whiten(rows, runs) / self.sigma


@dataclass(frozen=True)
class Fit:
    """Outcome of one fit.

    Attributes
    ----------
    values : (b,)
        Of the model's parameters.
    coefficients : (k,)
        Of the added columns.
    covariance : (b + k, b + k)
    noise_models : tuple of NoiseModel
    residuals : one (r_j,) array for each joint, N m, not whitened
    log_likelihood : float
        Concentrated, less one for each coefficient of a colour (Akaike).
    """

    values: FloatArray
    coefficients: FloatArray
    covariance: FloatArray
    noise_models: tuple[NoiseModel, ...]
    residuals: tuple[FloatArray, ...]
    log_likelihood: float

    @property
    def coefficient_covariance(self) -> FloatArray:
        """(k, k) of the added columns."""
        return self.covariance[len(self.values) :, len(self.values) :]


@dataclass(frozen=True)
class Regression:
    """Rows of all joints, with columns that were already added.

    Attributes
    ----------
    joints : tuple of JointData
    parameters : int
        b.
    added : tuple of Columns
        Blocks of columns, each by joint (r_j, k): a joint that is missing has zeros.
    """

    joints: tuple[JointData, ...]
    parameters: int
    added: tuple[Columns, ...] = field(default=())

    def with_columns(self, columns: Columns) -> "Regression":
        """Return the same with one more block."""
        return Regression(self.joints, self.parameters, (*self.added, columns))

    @cached_property
    def widths(self) -> tuple[int, ...]:
        """Columns of each block."""
        return tuple(next(iter(block.values())).shape[1] for block in self.added)

    def wide(self, joint: int) -> tuple[FloatArray, IntArray]:
        """Matrix (r, c + k) of one joint with the added columns, and their places."""
        data = self.joints[joint]
        parts, places = [data.matrix], [data.columns]
        start = self.parameters
        for block, width in zip(self.added, self.widths, strict=True):
            if joint in block:
                parts.append(block[joint])
                places.append(np.arange(start, start + width))
            start += width
        return np.hstack(parts), np.concatenate(places)

    @property
    def total(self) -> int:
        """Number of all coefficients: b + k."""
        return self.parameters + sum(self.widths)

    def first_noise_models(self) -> tuple[NoiseModel, ...]:
        """White noise, of the size that least squares leaves."""
        return white_noise_models(
            [
                data.torque - _least_squares(self.wide(joint)[0], data.torque)
                for joint, data in enumerate(self.joints)
            ]
        )

    def fit(
        self,
        noise_models: Sequence[NoiseModel] | None = None,
        *,
        steps: int | None = None,
    ) -> Fit:
        """Fit everything; colours are refined `steps` times from those given."""
        steps = settings.NOISE_MODEL_STEPS if steps is None else steps
        current = list(self.first_noise_models() if noise_models is None else noise_models)
        parts = [self.wide(joint) for joint in range(len(self.joints))]
        for step in range(steps + 1):
            normal, right = np.zeros((self.total, self.total)), np.zeros(self.total)
            for data, colour, (matrix, places) in zip(self.joints, current, parts, strict=True):
                white = colour.apply(np.column_stack([matrix, data.torque]), data.runs)
                normal[np.ix_(places, places)] += white[:, :-1].T @ white[:, :-1]
                right[places] += white[:, :-1].T @ white[:, -1]
            factor, scale = _factor(normal)
            solution = scale * cho_solve(factor, scale * right)
            residuals = tuple(
                data.torque - matrix @ solution[places]
                for data, (matrix, places) in zip(self.joints, parts, strict=True)
            )
            if step == steps:
                break
            current = [
                _colour(residual, data.runs)
                for residual, data in zip(residuals, self.joints, strict=True)
            ]
        inverse = cho_solve(factor, np.eye(self.total)) * np.outer(scale, scale)
        return Fit(
            values=solution[: self.parameters],
            coefficients=solution[self.parameters :],
            covariance=np.asarray(inverse),
            noise_models=tuple(current),
            residuals=residuals,
            log_likelihood=sum(
                _log_likelihood(residual, data.runs, colour)
                for residual, data, colour in zip(residuals, self.joints, current, strict=True)
            ),
        )

    def gain_of_last(self, fit: Fit) -> float:
        """Logarithm of the likelihood ratio of the last block, with the colours of `fit` for both.

        `fit` is of this regression. With a colour of its own the model without the block would
        take slow structure for noise: an offset, or gravity, that is left out is predictable from
        its past.
        """
        width = self.widths[-1]
        whole = np.concatenate([fit.values, fit.coefficients])
        inner = fit.covariance[-width:, -width:]
        without = (
            whole
            - fit.covariance[:, -width:] @ np.linalg.pinv(inner, hermitian=True) @ (whole[-width:])
        )
        gain = 0.0
        for joint, (data, colour) in enumerate(zip(self.joints, fit.noise_models, strict=True)):
            matrix, places = self.wide(joint)
            other = data.torque - matrix @ without[places]
            white = colour.apply(np.column_stack([fit.residuals[joint], other]), data.runs)
            energies = np.maximum(np.mean(white**2, axis=0), 1e-300)
            gain += 0.5 * len(white) * float(np.log(energies[1] / energies[0]))
        return gain

    def scan(self, fit: Fit) -> "Scan":
        """Prepare to try many candidates beside what is in the model now."""
        return Scan(self, fit)


class Scan:
    """Score of candidates with the colours of one fit: what each would take off the residual."""

    def __init__(self, regression: Regression, fit: Fit) -> None:
        self._regression = regression
        self._colours = fit.noise_models
        self._residuals = []
        self._white = []
        self._places = []
        normal = np.zeros((regression.total, regression.total))
        for joint, (data, colour) in enumerate(
            zip(regression.joints, fit.noise_models, strict=True)
        ):
            matrix, places = regression.wide(joint)
            white = colour.apply(matrix, data.runs)
            self._white.append(white)
            self._places.append(places)
            self._residuals.append(colour.apply(fit.residuals[joint], data.runs))
            normal[np.ix_(places, places)] += white.T @ white
        factor, self._scale = _factor(normal)
        self._factor = factor

    def whiten(self, columns: Columns) -> dict[int, FloatArray]:
        """Apply the colours to a candidate's columns."""
        return {
            joint: self._colours[joint].apply(rows, self._regression.joints[joint].runs)
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

    def right(self, white: Columns) -> FloatArray:
        """Whitened columns' products with the whitened residual, (k,)."""
        return np.asarray(sum(rows.T @ self._residuals[joint] for joint, rows in white.items()))

    def score(self, columns: Columns) -> tuple[float, FloatArray]:
        """Chi-square that the columns take off the whitened residual, and their coefficients.

        Columns that the model absorbs count for nothing.
        """
        white = self.whiten(columns)
        energy = self.energy(white)
        if not (energy < _LARGEST_ENERGY).all():  # infinite, not a number, or nearly so
            return 0.0, np.zeros(len(energy))
        normal = self.normal(white, white)
        usable = np.diag(normal) > np.maximum(settings.LEAST_INDEPENDENT * energy, _LEAST_ENERGY)
        coefficients = np.zeros(len(energy))
        if not usable.any():
            return 0.0, coefficients
        inner = normal[np.ix_(usable, usable)]
        if not np.isfinite(inner).all():
            return 0.0, coefficients
        right = self.right(white)[usable]
        factor, scale = _factor(inner, 1e-6)
        solution = scale * cho_solve(factor, scale * right)
        coefficients[usable] = solution
        return float(right @ solution), coefficients

    def _projected(self, white: Columns) -> FloatArray:
        """Coordinates of whitened columns in the model's span, (b + k0, k)."""
        width = next(iter(white.values())).shape[1]
        inner = np.zeros((len(self._scale), width))
        for joint, rows in white.items():
            inner[self._places[joint]] += self._white[joint].T @ rows
        lower, _ = self._factor
        return np.asarray(solve_triangular(lower, self._scale[:, None] * inner, lower=True))


_WHITE = AutoregressiveModel(np.zeros(0), 1.0)


def white_noise_models(residuals: Sequence[FloatArray]) -> tuple[NoiseModel, ...]:
    """White noise of the size of each joint's residual: weights of the least torque gap."""
    return tuple(NoiseModel(_WHITE, float(np.std(residual)) or 1.0) for residual in residuals)


def _factor(
    normal: FloatArray, ridge: float = _RIDGE
) -> tuple[tuple[FloatArray, bool], FloatArray]:
    """Cholesky factor of the normal matrix scaled to a unit diagonal, and the scale."""
    diagonal = np.diag(normal)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = normal * np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] = np.maximum(np.diag(scaled), 0.0) + ridge
    empty = diagonal <= 0.0
    scaled[empty, empty] = 1.0
    factor, lower = cho_factor(scaled, lower=True)
    return (np.tril(factor), lower), scale


def _least_squares(matrix: FloatArray, torque: FloatArray) -> FloatArray:
    return np.asarray(matrix @ np.linalg.lstsq(matrix, torque, rcond=None)[0])


def _colour(residual: FloatArray, runs: Sequence[slice]) -> NoiseModel:
    model = fit_autoregression(residual, runs, max_order=settings.NOISE_MODEL_ORDER)
    model = model.with_white_noise(settings.LEAST_DENSITY)
    return NoiseModel(model, float(np.sqrt(np.mean(model.whiten(residual, runs) ** 2))) or 1e-12)


def _log_likelihood(residual: FloatArray, runs: Sequence[slice], colour: NoiseModel) -> float:
    """Of one joint with its own innovations, less the order of its colour."""
    white = colour.model.whiten(residual, runs)
    variance = max(float(np.mean(white**2)), 1e-300)
    return float(-0.5 * len(residual) * np.log(variance)) - colour.model.order
