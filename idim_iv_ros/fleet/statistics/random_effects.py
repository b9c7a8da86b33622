"""Random effects: units whose true values scatter, each estimated with a known variance.

y_i = μ + u_i + e_i with u_i of variance τ² (between units) and e_i of variance v_i (known). The
generalised statistic Q(τ²) = Σ (y_i − μ̂(τ²))² / (v_i + τ²) falls with τ² and follows χ² with k − 1
degrees of freedom at the true one (DerSimonian and Kacker, Contemp. Clin. Trials 28, 2007):

- Q = k − 1 gives the estimate of Paule and Mandel (J. Res. NBS 87, 1982);
- Q = quantiles of χ² give an interval (Viechtbauer, Statist. Med. 26, 2007: Q-profile);
- the median over many groups of P(χ² < Q) being one half gives a τ² common to them that groups
  which differ do not move.

Columns are separate problems; NaN is a unit that has no estimate there.
"""

import numpy as np
import scipy

from idim_iv_ros.types import FloatArray

LEVEL = 0.95  # of every interval
_NEWTON = 60
_HALVINGS = 90
_CLOSE = 1e-12


def generalised_q(
    values: FloatArray, variances: FloatArray, between: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return Q, weighted mean, its variance, (m,) each, of values (k, m) at τ² = `between` (m,)."""
    estimated = np.isfinite(values) & np.isfinite(variances)
    weights = np.where(estimated, 1.0 / (np.where(estimated, variances, 1.0) + between), 0.0)
    filled = np.where(estimated, values, 0.0)
    total = weights.sum(axis=0)
    safe = np.where(total > 0.0, total, 1.0)
    mean = (weights * filled).sum(axis=0) / safe
    q = (weights * (filled - mean) ** 2).sum(axis=0)
    return q, np.where(total > 0.0, mean, np.nan), np.where(total > 0.0, 1.0 / safe, np.nan)


def between_variance(
    values: FloatArray, variances: FloatArray, target: FloatArray | None = None
) -> FloatArray:
    """Return τ² (m,) of values (k, m) at which Q equals `target` (m,); zero if Q is below it.

    By default the target is k − 1 of each column: the estimate of Paule and Mandel.
    """
    estimated = np.isfinite(values) & np.isfinite(variances)
    count = estimated.sum(axis=0)
    wanted = np.asarray(count - 1.0 if target is None else target, dtype=float)
    root = np.zeros(values.shape[1])
    open_columns = np.flatnonzero((count > 1) & (wanted > 0.0))
    filled = np.where(estimated, values, 0.0)[:, open_columns]
    noise = np.where(estimated, variances, np.inf)[:, open_columns]
    wanted = wanted[open_columns]
    total = estimated[:, open_columns].sum(axis=0)
    middle = filled.sum(axis=0) / total
    squares = (np.where(estimated[:, open_columns], filled - middle, 0.0) ** 2).sum(axis=0)
    # The root where all variances are equal. Q is convex and falls: Newton's step from below the
    # root never passes it, and one from above lands below or at zero.
    mean_noise = np.where(noise < np.inf, noise, 0.0).sum(axis=0) / total
    tau = np.maximum(squares / wanted - mean_noise, 0.0)
    for _ in range(_NEWTON):
        weights = 1.0 / (noise + tau)
        rest = filled - (weights * filled).sum(axis=0) / weights.sum(axis=0)
        q = (weights * rest**2).sum(axis=0)
        slope = (weights**2 * rest**2).sum(axis=0)
        change = (q - wanted) / np.where(slope > 0.0, slope, np.inf)
        settled = (tau == 0.0) & (q <= wanted)
        tau = np.maximum(tau + change, 0.0)
        if np.all(settled | (np.abs(change) <= _CLOSE * tau)):
            break
    root[open_columns] = tau
    return root


def common_between_variance(groups: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    """Return τ² (m,) common to groups: the median of P(χ² < Q) over groups is one half.

    Groups that scatter more than the others, by a drift or a fault, do not move it as long as they
    are fewer than half. A group has values and variances, (k_g, m) each, and does not count in a
    column where it has fewer than two units; NaN where no group counts.
    """
    counts = np.array([np.isfinite(v + s).sum(axis=0) for v, s in groups])
    usable = (counts > 1).any(axis=0)
    scattering = (counts > 1) | ~usable
    ranges = [np.ma.masked_invalid(values).ptp(axis=0).filled(0.0) for values, _ in groups]
    spread = np.max(ranges, axis=0)

    def median(between: FloatArray) -> FloatArray:
        q = np.array([generalised_q(v, s, between)[0] for v, s in groups])
        below = scipy.stats.chi2.cdf(q, np.maximum(counts - 1, 1))
        return np.asarray(np.nanmedian(np.where(scattering, below, np.nan), axis=0))

    low, high = np.zeros(len(spread)), np.maximum(spread, 1e-300) ** 2 * 1e3
    at_zero = median(low) <= 0.5
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        too_low = median(middle) > 0.5
        low, high = np.where(too_low, middle, low), np.where(too_low, high, middle)
    return np.where(usable, np.where(at_zero, 0.0, 0.5 * (low + high)), np.nan)


def type_estimate(values: FloatArray, variances: FloatArray) -> dict[str, FloatArray]:
    """Return mean, scatter and prediction interval (m,) of quantities over k robots of a type.

    By the names of `TypeQuantity`: ``mean`` with the interval of Hartung and Knapp (Statist. Med.
    20, 2001) at the τ² of Paule and Mandel, never narrower than by the estimates' variances;
    ``sigma``, from robot to robot, with its Q-profile interval; ``next_low`` and ``next_high``, the
    prediction interval of the next robot's true value (Higgins, Thompson and Spiegelhalter, J. R.
    Statist. Soc. A 172, 2009). NaN where there are too few robots: the prediction needs three,
    everything but the mean needs two.
    """
    count = (np.isfinite(values) & np.isfinite(variances)).sum(axis=0)
    between = between_variance(values, variances)
    _, mean, variance = generalised_q(values, variances, between)
    tail, dof = 0.5 * (1.0 - LEVEL), np.maximum(count - 1, 1)
    half = np.where(count > 1, scipy.stats.t.isf(tail, dof), np.nan)
    ahead = np.where(count > 2, scipy.stats.t.isf(tail, np.maximum(count - 2, 1)), np.nan)
    half, ahead = half * np.sqrt(variance), ahead * np.sqrt(between + variance)
    low = between_variance(values, variances, scipy.stats.chi2.isf(tail, dof))
    high = between_variance(values, variances, scipy.stats.chi2.ppf(tail, dof))
    sigmas = np.where(count > 1, np.sqrt([between, low, high]), np.nan)
    return {
        "mean": mean, "mean_low": mean - half, "mean_high": mean + half,
        "sigma": sigmas[0], "sigma_low": sigmas[1], "sigma_high": sigmas[2],
        "next_low": mean - ahead, "next_high": mean + ahead,
    }  # fmt: skip
