"""Essential parameters: the fewest that describe the torque as well as all (paper, V.B)."""

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class EssentialParameters:
    """Outcome of the backward elimination.

    `columns` (b_e,) int: base parameters that stay; `statistic`, `p_value`: F-test of the null
    hypothesis that all the others are zero.
    """

    columns: NDArray[np.int64]
    statistic: float
    p_value: float


def essential_parameters(
    values: FloatArray, covariance: FloatArray, rows: int, *, alpha: float = 0.05
) -> EssentialParameters:
    """Eliminate the parameter with the largest relative deviation while the F-test accepts it.

    F = ((‖ρ_e‖² - ‖ρ‖²)/(b - b_e)) / (‖ρ‖²/(r - b)) equals the Wald statistic β_outᵀ Σ_out⁻¹ β_out
    / (b - b_e) of the parameters that are left out; that form also holds for instrumental
    variables. It is judged against F(b - b_e, r - b).

    `values` (b,); `covariance` (b, b): that of whitened rows, for r must count independent rows;
    `rows`: r; `alpha`: level at which the null hypothesis is rejected and the elimination stops.
    """
    parameters = len(values)
    kept = list(range(parameters))
    statistic, p_value = 0.0, 1.0
    for _ in range(parameters - 1):
        estimate, std = restrict(values, covariance, kept)
        weakest = int(np.argmin(np.abs(estimate) / std))
        trial = kept[:weakest] + kept[weakest + 1 :]
        out = [column for column in range(parameters) if column not in trial]
        left_out = values[out]
        distance = float(left_out @ np.linalg.solve(covariance[np.ix_(out, out)], left_out))
        trial_statistic = distance / len(out)
        trial_p = float(scipy.stats.f.sf(trial_statistic, len(out), rows - parameters))
        if trial_p < alpha:
            break
        kept, statistic, p_value = trial, trial_statistic, trial_p
    return EssentialParameters(np.array(kept), statistic, p_value)


def restrict(
    values: FloatArray, covariance: FloatArray, kept: list[int]
) -> tuple[FloatArray, FloatArray]:
    """Estimate and standard deviation of `kept` once the other parameters are set to zero.

    Returns
    -------
    values, std : (len(kept),)
    """
    out = [column for column in range(len(values)) if column not in kept]
    inside = covariance[np.ix_(kept, kept)]
    if not out:
        return values[kept], np.sqrt(np.diag(inside))
    across = covariance[np.ix_(kept, out)]
    gain = np.linalg.solve(covariance[np.ix_(out, out)], across.T).T
    reduced = inside - gain @ across.T
    return values[kept] - gain @ values[out], np.sqrt(np.maximum(np.diag(reduced), 0.0))
