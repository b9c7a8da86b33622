"""How far the RMS of a residual scatters from one stretch of time to another.

A residual that is autocorrelated, has heavy tails or is larger in some motions has a mean square
that scatters more than that of as many independent Gaussian rows. How much more is measured on the
rows of the identification, a second at a time.
"""

import numpy as np
import scipy

from idim_iv_ros.types import FloatArray

_LEAST_SECONDS = 10  # with rows, below which their scatter is not known


def mean_square_freedom(time: FloatArray, residual: FloatArray) -> float | None:
    """Degrees of freedom that one row adds to the mean square; 1 for independent Gaussian rows.

    The mean square m of n rows has a variance of n⁻¹ v. From the sums S_b of r² - m over the
    seconds b, v is the long-run variance of S over the rows (Newey and West's weights, their
    number of lags), and the degrees of freedom of a χ² with the same mean and variance are
    2 m² n / v (Satterthwaite).

    Parameters
    ----------
    time : (n,) s
        Of the rows.
    residual : (n,) N m (N)

    Returns
    -------
    float or None
        Never above 1; None for fewer than ten seconds with rows, or no residual at all.
    """
    square = residual**2
    if len(square) == 0 or not square.any():
        return None
    seconds, place = np.unique(np.floor(time), return_inverse=True)
    if len(seconds) < _LEAST_SECONDS:
        return None
    mean = float(square.mean())
    sums = np.bincount(place, weights=square - mean)
    lags = int(4.0 * (len(seconds) / 100.0) ** (2.0 / 9.0))
    variance = float(sums @ sums)
    for lag in range(1, lags + 1):
        weight = 1.0 - lag / (lags + 1.0)
        variance += 2.0 * weight * float(sums[lag:] @ sums[:-lag])
    if variance <= 0.0:
        return 1.0
    return float(min(1.0, 2.0 * mean**2 * len(square) / variance))


def largest_share(
    freedom: float,
    identified_rows: int,
    rows: int,
    false_alarms: float,
    errors_of_parameters: float = 0.0,
) -> float | None:
    """RMS over that of the identification which `rows` rows pass with probability `false_alarms`.

    The mean square of the new rows is the sum of that of a residual which scatters as in the
    identification and of what errors of the parameters add in this motion. These are the same
    in all rows, so that their part has one degree of freedom at worst. The sum is taken for a χ²
    with its mean and variance (Satterthwaite), its ratio to the mean square of the identification
    for F.

    Parameters
    ----------
    freedom
        See `mean_square_freedom`.
    identified_rows, rows
        Of the identification, and those that are compared with it.
    false_alarms
        Probability, 0 to 1.
    errors_of_parameters
        Mean variance of the predictions by that of the parameters, over the mean square of the
        identification's residual.

    Returns
    -------
    float or None
        None where there are no rows.
    """
    if rows < 1 or identified_rows < 1:
        return None
    mean = 1.0 + errors_of_parameters
    variance = 2.0 / (freedom * rows) + 2.0 * errors_of_parameters**2
    own_freedom = 2.0 * mean**2 / variance
    quantile = scipy.stats.f.isf(false_alarms, own_freedom, freedom * identified_rows)
    return float(np.sqrt(mean * quantile))
