"""Generalised least squares of the rows of all joints, each with its own autocorrelated noise.

The likelihood is concentrated: coefficients, the variance of each joint's innovations and its
autoregressive model are those that fit best (candidates are compared by how far they make the
residual both small and white).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from idim_iv_ros.estimation.qr import NOT_SHOWN, Basis, independent_basis, stacked_r_factor
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals.autoregression import AutoregressiveModel, fit_autoregression
from idim_iv_ros.types import FloatArray

_NOISE_MODEL_ORDER = 10  # of an autoregression, at most
_NOISE_MODEL_STEPS = 3  # fits of the noise models from white noise
# Of the mean spectral density, that every frequency has: a model is wrong by a little everywhere.
_LEAST_DENSITY = 0.01

Columns = Mapping[int, FloatArray]


@dataclass(frozen=True)
class Fit:
    """Outcome of one fit: b parameters of the model and k coefficients of the added columns.

    A column that depends on those before it has zero coefficient and `covariance` (b + k, b + k);
    `residuals` (r_j,) of each joint, N m (N), are not whitened; `log_likelihoods` (n_joints,) are
    concentrated, less one for each coefficient of a noise model (Akaike), zero of a joint that is
    left out.
    """

    values: FloatArray
    coefficients: FloatArray
    covariance: FloatArray
    noise_models: tuple[AutoregressiveModel, ...]
    residuals: tuple[FloatArray, ...]
    log_likelihoods: FloatArray

    @property
    def log_likelihood(self) -> float:
        """Of all joints."""
        return float(self.log_likelihoods.sum())

    @property
    def coefficient_covariance(self) -> FloatArray:
        """(k, k) of the added columns."""
        return self.covariance[len(self.values) :, len(self.values) :]


@dataclass(frozen=True, eq=False)
class Regression:
    """Rows of all joints, and blocks of columns that were added to them.

    `joints`: without the added columns; `parameters`: b. `added`: columns by joint (r_j, k); a
    joint that is missing in a block has zeros.
    """

    joints: tuple[JointRows, ...]
    parameters: int
    added: tuple[Columns, ...] = ()

    def with_columns(self, *blocks: Columns) -> "Regression":
        """Return the same with more blocks."""
        return replace(self, added=(*self.added, *blocks))

    @cached_property
    def blocks(self) -> tuple[slice, ...]:
        """Which of the k added coefficients are those of each block."""
        ends = np.cumsum([0, *map(width_of, self.added)]).tolist()
        return tuple(slice(*block) for block in pairwise(ends))

    @cached_property
    def extended(self) -> tuple[JointRows, ...]:
        """Rows with all added columns; a joint that no block moves has its own."""
        added = np.arange(self.parameters, self.total)
        places = [added[block] for block in self.blocks]
        made = []
        for joint, rows in enumerate(self.joints):
            pairs = zip(self.added, places, strict=True)
            blocks = [(block[joint], place) for block, place in pairs if joint in block]
            if blocks:
                columns, numbers = zip(*blocks, strict=True)
                rows = rows.with_columns(np.hstack(columns), np.concatenate(numbers))
            made.append(rows)
        return tuple(made)

    @cached_property
    def total(self) -> int:
        """Number of all coefficients: b + k."""
        return self.parameters + sum(map(width_of, self.added))

    def fit(
        self,
        noise_models: Sequence[AutoregressiveModel] | None = None,
        *,
        steps: int = _NOISE_MODEL_STEPS,
    ) -> Fit:
        """Fit everything by QR; noise models are refined `steps` times from those given.

        Columns of which less than 1e-6 is independent of those before them are left out.
        """
        if noise_models is None:  # white noise, of the size that least squares leaves
            left = []
            for rows in self.extended:
                basis = independent_basis(rows.r_factor[:, :-1], tolerance=NOT_SHOWN)
                values = basis.solve(rows.r_factor[:, -1], len(rows.columns))
                left.append(rows.torque - rows.matrix @ values)
            noise_models = list(map(white_noise, self.joints, left))
        current = tuple(noise_models)
        for step in range(steps + 1):
            basis, torque = self.whitened_basis(current)
            solution = basis.solve(torque, self.total)
            residuals = tuple(rows.residual(solution) for rows in self.extended)
            if step < steps:
                current = tuple(map(noise_model, self.joints, residuals))
        root = basis.inverse_root(self.total)
        likelihoods = np.zeros(len(residuals))
        for joint, (rows, noise) in enumerate(zip(self.joints, current, strict=True)):
            if not rows.left_out:
                energy = np.mean(noise.whiten(residuals[joint], rows.segments) ** 2)
                variance = np.log(max(float(energy), 1e-300))
                likelihoods[joint] = -0.5 * len(residuals[joint]) * variance - noise.order
        return Fit(
            values=solution[: self.parameters],
            coefficients=solution[self.parameters :],
            covariance=root @ root.T,
            noise_models=current,
            residuals=residuals,
            log_likelihoods=likelihoods,
        )

    def whitened_basis(
        self, noise_models: Sequence[AutoregressiveModel]
    ) -> tuple[Basis, FloatArray]:
        """Orthonormal basis of all whitened columns, and the torque in the same coordinates."""
        pairs = zip(self.extended, noise_models, strict=True)
        factors = [rows.standardized_r_factor(noise) for rows, noise in pairs]
        places = [rows.places for rows in self.extended]
        factor = stacked_r_factor(factors, places, self.total + 1)
        return independent_basis(factor[:, :-1], tolerance=NOT_SHOWN), factor[:, -1]

    @cached_property
    def fitted(self) -> Fit:
        """`fit` from white noise: several steps ask for the same."""
        return self.fit()


def white_noise(rows: JointRows, residual: FloatArray) -> AutoregressiveModel:
    """White noise of the size of a residual; of rows that are left out, of the size assumed."""
    sigma = rows.assumed_sigma
    variance = float(np.var(residual)) or 1.0 if sigma is None else sigma**2
    return AutoregressiveModel(np.zeros(0), variance)


def noise_model(rows: JointRows, residual: FloatArray) -> AutoregressiveModel:
    """Autoregressive noise of one joint that believes no frequency to be almost without noise."""
    if rows.left_out:
        return white_noise(rows, residual)
    model = fit_autoregression(residual, rows.segments, max_order=_NOISE_MODEL_ORDER)
    model = model.with_white_noise(_LEAST_DENSITY)
    variance = float(np.mean(model.whiten(residual, rows.segments) ** 2))
    return replace(model, innovation_variance=variance or 1e-24)


def rms(values: FloatArray) -> float:
    """Root of the mean square of values (r,); zero of none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def width_of(columns: Columns) -> int:
    """How many columns a block has."""
    return int(next(iter(columns.values())).shape[1])
