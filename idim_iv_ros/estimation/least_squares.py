"""Linear estimators on the rows of all joints, IDIM-LS and one step of IDIM-IV (equation 9).

How uncertain their estimates are, and which parameters are essential. All work on R factors: the
rows of each joint are reduced once, and rows that are reduced already (`JointRows.reduced`,
`streamed_rows`) serve as well. ZᵀZ or ZᵀX, which squares the condition number, is never formed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.qr import NOT_SHOWN, independent_basis, r_factor, stacked_r_factor
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.types import FloatArray, IntArray

# Rounds of new weights; the estimate hardly depends on them.
_WEIGHTINGS = 3
# Columns of the instruments that are filtered at once, for the sake of memory.
_COLUMNS = 4


@dataclass(frozen=True)
class LinearEstimate:
    """Solution of a linear system in the base parameters.

    `values` (b,); `residuals` one (r_j,) array for each joint: y - X β, N m; `sigma` (n_joints,):
    standard deviation of each joint's residual, N m.
    """

    values: FloatArray
    residuals: tuple[FloatArray, ...]
    sigma: FloatArray


def solve_least_squares(
    rows: Sequence[JointRows], parameters: int, *, weighted: bool = True
) -> LinearEstimate:
    """IDIM-LS, ordinary or with each joint weighted by the inverse of its residual's σ.

    Raises DataError: fewer rows than parameters.
    """
    total = _number_of_rows(rows, parameters)
    # The b estimated parameters are charged to the joints in proportion to their rows.
    share = max(1.0 - parameters / total, 1.0 / total)
    weights = np.ones(len(rows))
    for _ in range(_WEIGHTINGS if weighted else 1):
        factor = stacked(rows, parameters, weights)
        values = independent_basis(factor[:, :-1]).solve(factor[:, -1], parameters)
        sigma = _sigma(rows, values, share, total)
        weights = 1.0 / sigma
    return _estimate(rows, values, sigma)


def solve_instrumental_variables(
    rows: Sequence[JointRows], parameters: int, sigma: FloatArray
) -> LinearEstimate:
    """β = (ZᵀΩ⁻¹X)⁻¹ ZᵀΩ⁻¹y with Ω = blkdiag(σ_j² I) (equation 9, weighted joint by joint).

    Solved on the R factor of [Z X y]: with Z = QR it is (QᵀX)⁻¹ Qᵀy.

    Raises DataError: fewer rows than parameters, or the instruments do not determine the
    parameters.
    """
    total = _number_of_rows(rows, parameters)
    _, projected, right = projected_on_instruments(rows, parameters, sigma)
    values = np.asarray(np.linalg.solve(projected, right), dtype=np.float64)
    return _estimate(rows, values, _sigma(rows, values, 1.0 - parameters / total, total))


def projected_on_instruments(
    rows: Sequence[JointRows], parameters: int, sigma: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """R, QᵀX, both (b, b), and Qᵀy of the stacked Z = Q R, joint j weighted by 1/`sigma[j]`.

    Raises DataError: the instruments do not determine the parameters.
    """
    factor = stacked_with_instruments(rows, parameters, sigma)
    instruments = independent_basis(factor[:, :parameters])
    projected = instruments.vectors.T @ factor[:, parameters:-1]
    if independent_basis(projected).rank < parameters:
        raise DataError("the instruments do not determine all parameters")
    return instruments.upper, projected, instruments.vectors.T @ factor[:, -1]


def stacked(
    rows: Sequence[JointRows], parameters: int, weights: FloatArray | None = None
) -> FloatArray:
    """R factor (b + 1 columns) of [X y] of all joints, joint j multiplied by `weights[j]`."""
    factors = [joint.r_factor for joint in rows]
    if weights is not None:
        factors = [factor * weight for factor, weight in zip(factors, weights, strict=True)]
    return stacked_r_factor(factors, [joint.places for joint in rows], parameters + 1)


def stacked_with_instruments(
    rows: Sequence[JointRows], parameters: int, sigma: FloatArray
) -> FloatArray:
    """R factor (2b + 1 columns) of [Z X y] of all joints, joint j divided by `sigma[j]`."""
    factors = [joint.instrumental_r_factor / s for joint, s in zip(rows, sigma, strict=True)]
    columns = [joint.columns for joint in rows]
    places = [np.concatenate([c, c + parameters, [2 * parameters]]) for c in columns]
    return stacked_r_factor(factors, places, 2 * parameters + 1)


def unseen_parameters(rows: Sequence[JointRows], parameters: int) -> list[int]:
    """Base parameters whose columns depend on those before them in these rows."""
    columns = stacked(rows, parameters)[:, :parameters]
    norms = np.linalg.norm(columns, axis=0)
    columns[:, norms <= NOT_SHOWN * norms.max()] = 0.0
    shown = independent_basis(columns, tolerance=NOT_SHOWN).kept
    return sorted(set(range(parameters)) - set(shown.tolist()))


def condition_number(rows: Sequence[JointRows], parameters: int) -> float:
    """Condition number of the stacked, unweighted observation matrix X."""
    return float(np.linalg.cond(stacked(rows, parameters)[:parameters, :parameters]))


def _sigma(rows: Sequence[JointRows], values: FloatArray, share: float, total: int) -> FloatArray:
    """Standard deviation of each joint's residual; not so small that its weight is infinite."""
    sigma = [
        joint.assumed_sigma
        or np.linalg.norm(joint.reduced.residual(values)) / np.sqrt(max(len(joint) * share, 1.0))
        for joint in rows
    ]
    torque = max(float(np.linalg.norm(joint.reduced.torque)) for joint in rows) / np.sqrt(total)
    return np.maximum(sigma, max(1e-12 * torque, 1e-300))


def _estimate(rows: Sequence[JointRows], values: FloatArray, sigma: FloatArray) -> LinearEstimate:
    return LinearEstimate(values, tuple(joint.residual(values) for joint in rows), sigma)


def _number_of_rows(rows: Sequence[JointRows], parameters: int) -> int:
    total = sum(len(joint) for joint in rows)
    if total <= parameters:
        raise DataError(
            f"{total} decimated rows cannot determine {parameters} parameters; record for longer "
            "or raise processing.decimation_cutoff"
        )
    return total


def white_covariance(rows: Sequence[JointRows], sigma: FloatArray, parameters: int) -> FloatArray:
    """Σ = (ZᵀWX)⁻¹ ZᵀWZ (XᵀWZ)⁻¹ (b, b), W = blkdiag(I/σ_j²): right if every residual is white.

    With Z = X it is the covariance of (weighted) least squares, σ²(XᵀX)⁻¹. `sigma` (n_joints,):
    standard deviation of each joint's residual, N m (N); `parameters`: b.

    Raises DataError: the instruments do not determine all parameters.
    """
    _, projected, _ = projected_on_instruments(rows, parameters, sigma)
    root = np.linalg.inv(projected)
    return np.asarray(root @ root.T)


def refined_covariance(rows: Sequence[JointRows], sigma: FloatArray, parameters: int) -> FloatArray:
    """Σ = (Z_fᵀ W Z_f)⁻¹ of the refined estimate (paper, equation 12), joint by joint weighted.

    The rows are filtered by Ĉ_j(z⁻¹), and sigma is that of the whitened residual; with one σ for
    all joints it is the paper's σ̂²(Z_fᵀZ_f)⁻¹. Parameters as for `white_covariance`.
    """
    upper, _, _ = projected_on_instruments(rows, parameters, sigma)
    root = independent_basis(upper).inverse_root(parameters)
    return root @ root.T


@dataclass(frozen=True)
class AutocorrelatedCovariance:
    """Σ = A S Aᵀ of the estimate from unfiltered rows, when each joint's residual is AR(p).

    A = (ZᵀWX)⁻¹ and S = Σ_j σ_j⁻⁴ Z_jᵀ R_j Z_j, with R_j the covariance of the joint's residual
    at the places of its rows; Z_jᵀ R_j Z_j = σ²_N,j ‖H_jᵀ Z_j‖² with H_j = 1/Ĉ_j on the regular
    grid, where Z_j is zero at the dropped rows.

    - `rows`: unfiltered, with their `position`
    - `sigma`: (n_joints,), standard deviation of each joint's residual: the weights of the estimate
    - `models`: fitted on the residual of each joint, in its unit
    """

    rows: Sequence[JointRows]
    sigma: FloatArray
    models: Sequence[AutoregressiveModel]
    parameters: int

    @property
    def matrix(self) -> FloatArray:
        """(b, b), in the products of the parameters' units."""
        return self.restricted(np.arange(self.parameters))

    def restricted(self, kept: IntArray) -> FloatArray:
        """Covariance (b_e, b_e) of the estimate with only the parameters `kept`, same weights."""
        rows = [joint.reduced.keep(kept) for joint in self.rows]
        upper, projected, _ = projected_on_instruments(rows, len(kept), self.sigma)
        spectrum = r_factor(self._spectrum[:, kept])
        # A = (Rᵀ QᵀX)⁻¹ = (QᵀX)⁻¹ R⁻ᵀ, so that Σ = BᵀB with B = S^½ R⁻¹ (QᵀX)⁻ᵀ.
        root = np.linalg.solve(projected, np.linalg.solve(upper.T, spectrum.T)).T
        return np.asarray(root.T @ root)

    @cached_property
    def _spectrum(self) -> FloatArray:
        """Upper triangular root (b, b) of S, the middle of Σ = A S Aᵀ."""
        factors = [
            _shaped_r_factor(joint, model) * np.sqrt(model.innovation_variance) / sigma**2
            for joint, sigma, model in zip(self.rows, self.sigma, self.models, strict=True)
        ]
        return stacked_r_factor(factors, [joint.columns for joint in self.rows], self.parameters)


def _shaped_r_factor(rows: JointRows, model: AutoregressiveModel) -> FloatArray:
    """R factor of H_jᵀ Z_j, a joint's instruments after the transposed shaping filter."""
    assert rows.position is not None
    width = len(rows.columns)
    shaped = np.zeros((0, width))
    for start in range(0, width, _COLUMNS):
        columns = rows.instruments[:, start : start + _COLUMNS]
        part = model.shaping_adjoint(columns, rows.position)
        if not len(shaped):
            shaped = np.empty((len(part), width))
        shaped[:, start : start + _COLUMNS] = part
    return r_factor(shaped)


def essential_parameters(
    values: FloatArray, covariance: FloatArray, rows: int, *, alpha: float = 0.05
) -> tuple[IntArray, float]:
    """Eliminate the parameter with the largest relative deviation while the F-test accepts it.

    F = ((‖ρ_e‖² - ‖ρ‖²)/(b - b_e)) / (‖ρ‖²/(r - b)) equals the Wald statistic β_outᵀ Σ_out⁻¹ β_out
    / (b - b_e) of the parameters that are left out; that form also holds for instrumental
    variables. It is judged against F(b - b_e, r - b).

    `values` (b,), `covariance` (b, b): of whitened rows, for r must count independent rows; `rows`:
    r; `alpha`: level below which the elimination stops. Returns the base parameters that stay,
    (b_e,), and the p-value of the null hypothesis that all the others are zero.
    """
    kept, p_value = list(range(len(values))), 1.0
    out: list[int] = []
    while len(kept) > 1:
        estimate, std = restrict(values, covariance, kept)
        weakest = kept[int(np.argmin(np.abs(estimate) / std))]
        out = sorted([*out, weakest])
        distance = float(values[out] @ np.linalg.solve(covariance[np.ix_(out, out)], values[out]))
        trial_p = float(scipy.stats.f.sf(distance / len(out), len(out), rows - len(values)))
        if trial_p < alpha:
            break
        kept.remove(weakest)
        p_value = trial_p
    return np.array(kept), p_value


def restrict(
    values: FloatArray, covariance: FloatArray, kept: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Estimates and standard deviations (k,) of `kept` once the other parameters are zero."""
    out = [column for column in range(len(values)) if column not in kept]
    across = covariance[np.ix_(kept, out)]
    gain = np.linalg.solve(covariance[np.ix_(out, out)], across.T).T
    reduced = covariance[np.ix_(kept, kept)] - gain @ across.T
    return values[kept] - gain @ values[out], np.sqrt(np.maximum(np.diag(reduced), 0.0))
