"""What the residual of a joint says: autocorrelation, distribution, scatter of its RMS in time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from idim_iv_ros.documents import Number, Unsaved
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.signals.autoregression import AutoregressiveModel, fit_autoregression
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.types import FloatArray

WHITE = "the residual is white"
WHITENED = "the residual filtered by its autoregressive model is white"
NORMAL = "the whitened residual is Gaussian"

_EXTRA_LAGS = 20
_HARMLESS_SHARE = 0.05
_HARMLESS_UNDERSTATEMENT = 1.1
_LEAST_ROWS = 30
_LEAST_SECONDS = 10  # with rows, below which their scatter is not known


def beyond_noise(share: float, size: float, noise: float) -> float:
    """Part of a share that lies beyond the energy of the noise; `size`, `noise`: in one unit."""
    return share * math.sqrt(1.0 - min(noise / size, 1.0) ** 2) if size > 0.0 else share


@dataclass(frozen=True, kw_only=True)
class ResidualDiagnosis:
    """How large the residual of a joint is, and whether it is white.

    - `rms`: N m (N for a prismatic joint)
    - `relative_percent`: 100 ‖y − Xβ̂‖ / ‖y‖; None if there is no torque
    - `ar_order`: order of the autoregressive model by AIC, 0 for white
    - `white`: whether the residual may be treated as white: Ljung-Box accepts it, or what it finds
      is harmless: its past predicts less than 5 % of its variance and the standard deviations
      computed as if it were white are less than 1.1 times too small. None if not tested.
    - `whiteness_p_value`, `normality_p_value`: those of the tests, whatever is given
    - `predictable_share`: share of the variance that the residual's own past predicts
    - `sigma_understatement`: how many times too small the white-noise standard deviations of the
      estimates are, median over the columns of Z: σ_N ‖Hᵀ z‖ / (σ_ε ‖z‖)
    - `largest_correlation_after`: largest |autocorrelation| that the filter leaves beyond lag 0
    - `whiteness`: Ljung-Box on the residual itself; before whitening only a description, since it
      takes the regressors as exogenous
    - `whiteness_after`: Ljung-Box on the whitened residual, its degrees of freedom less the order
    - `skewness`, `excess_kurtosis`: effect sizes of normality, both 0 for a Gaussian. With
      thousands of rows a kurtosis that harms nothing is significant.
    - `autoregression`: of the residual; like what follows it is for the report and in no document
    - `acf`, `acf_whitened`: (n_lags + 1,), autocorrelation from lag 0, of the residual and of the
      whitened residual
    - `acf_bound`: 95 % of the autocorrelations of white noise lie within ± this, 1.96 / √r
    """

    joint: str
    rms: Number
    relative_percent: float | None
    ar_order: int
    white: bool | None
    whiteness_p_value: float | None = None
    normality_p_value: float | None = None
    predictable_share: Number
    sigma_understatement: Number
    largest_correlation_after: Number
    skewness: Number
    excess_kurtosis: Number
    whiteness: HypothesisTest
    whiteness_after: HypothesisTest
    normality: HypothesisTest
    autoregression: Unsaved[AutoregressiveModel | None] = field(default=None, compare=False)
    acf: Unsaved[FloatArray] = field(default_factory=lambda: np.zeros(0), compare=False)
    acf_whitened: Unsaved[FloatArray] = field(default_factory=lambda: np.zeros(0), compare=False)
    acf_bound: Unsaved[float] = field(default=0.0, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "whiteness_p_value", self.whiteness.p_value)
        object.__setattr__(self, "normality_p_value", self.normality.p_value)


def diagnose_residual(
    rows: JointRows, parameters: FloatArray, *, alpha: float = 0.05
) -> ResidualDiagnosis:
    """Diagnose the residual y_j − X_j β̂ of one joint (paper, section IV).

    `rows`: unfiltered rows; `parameters` (b,): β̂; `alpha`: level of each test.
    """
    residual = rows.residual(parameters)
    count = len(residual)
    model = fit_autoregression(residual, rows.segments)
    whitened = model.whiten(residual, rows.segments)
    n_lags = max(0, min(model.order + _EXTRA_LAGS, count // 5))
    understatement = _sigma_understatement(model, rows)
    whiteness = ljung_box(residual, rows.segments, WHITE, rows.name, n_lags, alpha=alpha)
    share = model.predictable_share
    harmless = share < _HARMLESS_SHARE and understatement < _HARMLESS_UNDERSTATEMENT
    skewness, kurtosis, normality = _normality(whitened, rows.name, alpha)
    energy = float(rows.torque @ rows.torque)
    acf_whitened = autocorrelation(whitened, rows.segments, n_lags)
    return ResidualDiagnosis(
        joint=rows.name,
        rms=float(np.sqrt(np.mean(residual**2))) if count else 0.0,
        relative_percent=100.0 * float(np.sqrt(residual @ residual / energy)) if energy else None,
        ar_order=model.order,
        white=None if whiteness.accepted is None else whiteness.accepted or harmless,
        predictable_share=share,
        sigma_understatement=understatement,
        largest_correlation_after=float(np.abs(acf_whitened[1:]).max(initial=0.0)),
        skewness=skewness,
        excess_kurtosis=kurtosis,
        whiteness=whiteness,
        whiteness_after=ljung_box(
            whitened, rows.segments, WHITENED, rows.name, n_lags, model.order, alpha=alpha
        ),
        normality=normality,
        autoregression=model,
        acf=autocorrelation(residual, rows.segments, n_lags),
        acf_whitened=acf_whitened,
        acf_bound=1.96 / np.sqrt(max(1, count)),
    )


def autocorrelation(series: FloatArray, segments: Sequence[slice], n_lags: int) -> FloatArray:
    """(n_lags + 1,) autocorrelation of `series` (r,), from pairs within one segment only."""
    if len(series) == 0 or np.ptp(series) == 0.0:
        return np.append(1.0, np.zeros(n_lags))
    centred = series - series.mean()
    lengths = [segment.stop - segment.start for segment in segments]
    segment_of = np.repeat(np.arange(len(segments)), lengths)
    products = [float(centred @ centred)]
    for lag in range(1, n_lags + 1):
        together = segment_of[lag:] == segment_of[:-lag]
        products.append(float(np.sum(centred[lag:] * centred[:-lag] * together)))
    return np.array(products) / products[0]


def ljung_box(
    series: FloatArray,
    segments: Sequence[slice],
    null: str,
    scope: str,
    n_lags: int,
    fitted: int = 0,
    *,
    alpha: float = 0.05,
) -> HypothesisTest:
    """Ljung-Box test, Q = r(r + 2) Σ_k ρ_k² / n_k against χ²(n_lags − fitted).

    n_k is the number of pairs at lag k within a segment, r − k for a single segment.

    `series`: (r,), a residual, raw or whitened. `segments`: rows that are contiguous in time.
    `fitted`: how many coefficients of a filter were fitted on this series.
    """
    count, dof = len(series), n_lags - fitted
    if count < _LEAST_ROWS or dof < 1:
        return HypothesisTest.not_run(null, scope, f"{count} rows are too few", alpha)
    if np.ptp(series) == 0.0:
        return HypothesisTest.not_run(null, scope, "the residual is constant", alpha)
    lengths = np.array([segment.stop - segment.start for segment in segments])
    pairs = np.array([np.maximum(lengths - lag, 0).sum() for lag in range(1, n_lags + 1)])
    correlation = autocorrelation(series, segments, n_lags)[1:]
    seen = pairs > 0
    dof -= int(np.count_nonzero(~seen))
    if dof < 1:
        return HypothesisTest.not_run(null, scope, "its segments are too short", alpha)
    statistic = count * (count + 2) * float(np.sum(correlation[seen] ** 2 / pairs[seen]))
    p_value = float(scipy.stats.chi2.sf(statistic, dof))
    deviation = float(np.abs(correlation[seen]).max())
    return HypothesisTest(null, scope, statistic, dof, None, p_value, deviation, alpha)


def _sigma_understatement(model: AutoregressiveModel, rows: JointRows) -> float:
    """Median over the columns of Z of the true over the white-noise standard deviation."""
    energy = np.linalg.norm(rows.instruments, axis=0)
    seen = energy > 0.0
    if model.order == 0 or not seen.any():
        return 1.0
    shaped = np.zeros_like(energy)
    for segment in rows.segments:
        positions = np.arange(segment.stop - segment.start)
        adjoint = model.shaping_adjoint(rows.instruments[segment], positions)
        shaped += np.sum(adjoint**2, axis=0)
    ratio = np.sqrt(shaped[seen] * (1.0 - model.predictable_share)) / energy[seen]
    return float(np.median(ratio))


def excess_kurtosis(values: FloatArray) -> float:
    """Excess kurtosis about zero of (r,): large where a few have the energy, −3 where all are 0."""
    energy = values**2
    return float(np.mean(energy**2) / max(float(np.mean(energy)) ** 2, 1e-300)) - 3.0


def _normality(series: FloatArray, scope: str, alpha: float) -> tuple[float, float, HypothesisTest]:
    """Skewness S, excess kurtosis K (0 of a constant), and r/6 (S² + K²/4) against χ²(2)."""
    count, skewness, kurtosis = len(series), 0.0, 0.0
    if count and np.var(series) != 0.0:
        unit = (series - series.mean()) / np.std(series)
        skewness, kurtosis = float(np.mean(unit**3)), float(np.mean(unit**4)) - 3.0
    if count < _LEAST_ROWS:
        few = HypothesisTest.not_run(NORMAL, scope, f"{count} rows are too few", alpha)
        return skewness, kurtosis, few
    statistic = count / 6.0 * (skewness**2 + kurtosis**2 / 4.0)
    deviation, p_value = max(abs(skewness), abs(kurtosis)), float(scipy.stats.chi2.sf(statistic, 2))
    test = HypothesisTest(NORMAL, scope, statistic, 2, None, p_value, deviation, alpha)
    return skewness, kurtosis, test


def mean_square_freedom(time: FloatArray, residual: FloatArray) -> float | None:
    """Degrees of freedom that one row adds to the mean square; 1 for independent Gaussian rows.

    The mean square m of n rows has a variance of n⁻¹ v. From the sums S_b of r² - m over the
    seconds b, v is the long-run variance of S over the rows (Newey and West's weights, their
    number of lags), and the degrees of freedom of a χ² with the same mean and variance are
    2 m² n / v (Satterthwaite).

    `time` (n,) s: of the rows; `residual` (n,) N m (N). Returns at most 1; None for fewer than ten
    seconds with rows, or no residual at all.
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
    return float(min(1.0, 2.0 * mean**2 * len(square) / variance)) if variance > 0.0 else 1.0


def largest_share(
    freedom: float,
    identified_rows: int,
    rows: int,
    false_alarms: float,
    errors_of_parameters: float = 0.0,
) -> float | None:
    """RMS over that of the identification which `rows` rows pass with probability `false_alarms`.

    The mean square of the new rows is the sum of that of a residual which scatters as in the
    identification and of what errors of the parameters add in this motion. These are the same in
    all rows, so that their part has one degree of freedom at worst. The sum is taken for a χ² with
    its mean and variance (Satterthwaite), its ratio to the mean square of the identification for F.

    `identified_rows`, `rows`: of the identification, and those that are compared with it.
    `errors_of_parameters`: mean variance of the predictions by that of the parameters, over the
    mean square of the identification's residual. Returns None where there are no rows.
    """
    if rows < 1 or identified_rows < 1:
        return None
    mean = 1.0 + errors_of_parameters
    variance = 2.0 / (freedom * rows) + 2.0 * errors_of_parameters**2
    new_freedom = 2.0 * mean**2 / variance
    quantile = scipy.stats.f.isf(false_alarms, new_freedom, freedom * identified_rows)
    return float(np.sqrt(mean * quantile))
