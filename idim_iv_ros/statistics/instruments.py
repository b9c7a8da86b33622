"""The revised Durbin-Wu-Hausman test: are the instruments valid?  H0: Π = I in X = Z Π + V.

Π has b × b entries, 3,600 for the TX40: no recording can test them all. What counts is the
torque. Π = I says that the prediction X β̂ with the measured motion, regressed on Z, gives β̂
back; so (X − Z) β̂ = Z δ + v is fitted and δ = 0 tested, an F-test of as many restrictions as
there are columns, on rows whitened by the autoregressive model of v. (The colour of v is not
that of the residual of the torque.)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from idim_iv_ros.estimation.r_factor import r_factor, spread
from idim_iv_ros.statistics.basis import independent_basis
from idim_iv_ros.statistics.effect_size import largest_deviation, torque_deviation
from idim_iv_ros.statistics.gls import GlsRegression, gls_regression
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.joint_rows import JointRows
from idim_iv_ros.types import FloatArray

NULL = "the instruments are valid (Π = I)"
_ROWS_PER_COLUMN = 5
_EQUAL = 1e-10


def wald_test_of_instruments(
    joints: Sequence[JointRows],
    parameters: FloatArray,
    *,
    alpha: float = 0.05,
    not_simulated: str | None = None,
    simulation_errors: Sequence[FloatArray] | None = None,
) -> tuple[HypothesisTest, ...]:
    """Test the instruments for all rows and joint by joint (paper, equation 10).

    Parameters
    ----------
    joints : sequence of JointRows
        Unfiltered rows; the test whitens them itself.
    parameters : (b,)
        The IDIM-IV estimate β̂.
    alpha : float
        Level of each test.
    not_simulated : str, optional
        Why the instruments do not come from a simulation of the loop. Such instruments share
        the noise of X by construction, and no test is run.

    simulation_errors : sequence of (r_j, n_draws), optional
        Draws of the change of Z β̂ that comes from the uncertainty of the parameters with which
        the instruments were simulated. Without them the parameters are taken as known.

    Returns
    -------
    tuple of HypothesisTest
        Scope "all" first, then one for each joint in the order given. `max_deviation` is that
        of `largest_deviation`; `torque_deviation_percent` is 100 ‖Z δ̂‖ / ‖X β̂‖ less what
        noise alone would give (for "all": root mean square over the joints).
    """
    fits: list[_Fit] = []
    tests: list[HypothesisTest] = []
    draws = simulation_errors or [np.zeros((len(rows.torque), 0)) for rows in joints]
    for rows, errors in zip(joints, draws, strict=True):
        reason = not_simulated or _obstacle(rows, parameters)
        if reason is not None:
            tests.append(HypothesisTest.not_run(NULL, rows.joint, reason, alpha))
            continue
        difference = rows.prediction(parameters) - rows.instruments @ parameters[rows.columns]
        fit = gls_regression(difference, rows.instruments, rows.runs)
        columns = np.column_stack([rows.instruments, difference, errors])
        whitened = r_factor(fit.errors.whiten(columns, rows.runs))
        fits.append(_Fit(rows, fit, whitened))
        tests.append(_test_of_joint(fits[-1], parameters, alpha))
    if fits:
        return (_test_of_all(fits, parameters, alpha), *tests)
    reasons = {test.reason for test in tests if test.reason}
    reason = reasons.pop() if len(reasons) == 1 else "no joint can be tested"
    return (HypothesisTest.not_run(NULL, "all", reason, alpha), *tests)


def _obstacle(rows: JointRows, parameters: FloatArray) -> str | None:
    """Why this joint cannot be tested, or None."""
    n_rows, width = rows.instruments.shape
    if width == 0:
        return "no parameter acts on this joint"
    if n_rows < _ROWS_PER_COLUMN * width:
        return f"{n_rows} rows for {width} columns are too few"
    predicted = rows.prediction(parameters)
    if not np.any(predicted):
        return "the model predicts no torque"
    difference = predicted - rows.instruments @ parameters[rows.columns]
    if np.linalg.norm(difference) <= _EQUAL * np.linalg.norm(predicted):
        return "the instruments equal the regressor, so there is no error V to test"
    return None


def _test_of_joint(fitted: "_Fit", parameters: FloatArray, alpha: float) -> HypothesisTest:
    rows, fit = fitted.rows, fitted.regression
    energy = torque_deviation(fit.coefficients, fit.covariance_root, rows.instruments)
    return _fisher_test(
        rows.joint,
        fitted.whitened,
        rows.instruments.shape[1],
        fit.n_rows,
        largest_deviation(_both(rows), fit.n_rows),
        100.0 * float(np.sqrt(energy) / np.linalg.norm(rows.prediction(parameters))),
        alpha,
    )


def _test_of_all(fits: Sequence["_Fit"], parameters: FloatArray, alpha: float) -> HypothesisTest:
    """Stack the whitened joints, each divided by its σ of v, with one δ for all."""
    width = len(parameters)
    n_rows = sum(fitted.regression.n_rows for fitted in fits)
    whitened, both = [], []
    for fitted in fits:
        rows = fitted.rows
        sigma = np.sqrt(fitted.regression.variance)
        more = fitted.whitened.shape[1] - len(rows.columns)
        places = np.append(rows.columns, np.arange(width, width + more))
        whitened.append(spread(fitted.whitened / sigma, places, width + more))
        places = np.concatenate([rows.columns, rows.columns + width])
        both.append(spread(_both(rows) / sigma, places, 2 * width))
    stacked = r_factor(np.vstack(whitened))
    basis = independent_basis(stacked[:, :width])
    delta, root = basis.solve(stacked[:, width], width), basis.inverse_root(width)
    shares = []
    for fitted in fits:
        rows = fitted.rows
        energy = torque_deviation(delta[rows.columns], root[rows.columns], rows.instruments)
        prediction = rows.prediction(parameters)
        shares.append(energy / float(prediction @ prediction))
    return _fisher_test(
        "all",
        stacked,
        width,
        n_rows,
        largest_deviation(r_factor(np.vstack(both)), n_rows),
        100.0 * float(np.sqrt(np.mean(shares))),
        alpha,
    )


def _both(rows: JointRows) -> FloatArray:
    return r_factor(np.hstack([rows.instruments, rows.regressor]))


@dataclass(frozen=True)
class _Fit:
    """One joint: its rows, the coloured regression, and the triangle of [Z, (X − Z) β̂, draws]."""

    rows: JointRows
    regression: GlsRegression
    whitened: FloatArray


def _fisher_test(
    scope: str,
    reduced: FloatArray,
    width: int,
    n_rows: int,
    deviation: float | None,
    torque_percent: float,
    alpha: float,
) -> HypothesisTest:
    """F-test of δ = 0 from the triangle of the whitened [Z, (X − Z) β̂, draws].

    Without draws Q = ‖P_Z (X − Z) β̂‖² is σ² χ²(b) under the null hypothesis. With them its
    covariance on the span of Z is σ² I + A, A that of the draws; Q is then compared with the
    scaled χ² of the same mean and variance (Satterthwaite), 2 tr (σ² I + A)².
    """
    basis = independent_basis(reduced[:, :width])
    projection = basis.vectors.T @ reduced[:, width]
    rest = basis.remove(reduced[:, width])
    rank, dof = basis.rank, n_rows - basis.rank
    unexplained = float(rest @ rest)
    if rank == 0 or dof <= 0 or unexplained <= 0.0:
        return HypothesisTest.not_run(NULL, scope, "no error V is left to judge by", alpha)
    variance = unexplained / dof
    trace, trace_of_square = _draws_energy(basis.vectors.T @ reduced[:, width + 1 :], rank)
    mean = rank * variance + trace
    spread_of_energy = rank * variance**2 + 2.0 * variance * trace + trace_of_square
    freedom = max(1, round(mean**2 / spread_of_energy))
    statistic = float(projection @ projection) / mean
    p_value = float(scipy.stats.f.sf(statistic, freedom, dof))
    return HypothesisTest(
        NULL,
        scope,
        statistic,
        freedom,
        dof,
        p_value,
        deviation,
        alpha,
        torque_deviation_percent=torque_percent,
    )


def _draws_energy(draws: FloatArray, rank: int) -> tuple[float, float]:
    """Tr A and tr A² of the covariance A of draws (rank, n_draws)."""
    count = draws.shape[1]
    if count < 2:
        return 0.0, 0.0
    products = draws.T @ draws
    trace = float(np.trace(products)) / count
    apart = products[~np.eye(count, dtype=bool)]
    square = float(np.mean(apart**2))
    return trace, min(max(square, trace**2 / rank), trace**2)
