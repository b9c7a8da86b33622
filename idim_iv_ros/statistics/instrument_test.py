"""The revised Durbin-Wu-Hausman test: are the instruments valid?  H0: Π = I in X = Z Π + V.

Π has b × b entries, 3,600 for the TX40: no recording can test them all. What counts is the
torque. Π = I says that the prediction X β̂ with the measured motion, regressed on Z, gives β̂
back; so (X − Z) β̂ = Z δ + v is fitted and δ = 0 tested, an F-test of as many restrictions as
there are columns, on rows whitened by the autoregressive model of v. (The colour of v is not
that of the residual of the torque.)
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from idim_iv_ros.statistics.coloured_regression import ColouredRegression, regress_coloured
from idim_iv_ros.statistics.effect_size import largest_deviation, torque_deviation
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.joint_rows import JointRows
from idim_iv_ros.statistics.triangle import independent_basis, spread, triangle

FloatArray = NDArray[np.float64]

NULL = "the instruments are valid (Π = I)"
_ROWS_PER_COLUMN = 5
_EQUAL = 1e-10


def wald_test_of_instruments(
    joints: Sequence[JointRows],
    parameters: FloatArray,
    *,
    alpha: float = 0.05,
    not_simulated: str | None = None,
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

    Returns
    -------
    tuple of HypothesisTest
        Scope "all" first, then one for each joint in the order given. `max_deviation` is that
        of `largest_deviation`; `torque_deviation_percent` is 100 ‖Z δ̂‖ / ‖X β̂‖ less what
        noise alone would give (for "all": root mean square over the joints).
    """
    fits: list[tuple[JointRows, ColouredRegression]] = []
    tests: list[HypothesisTest] = []
    for rows in joints:
        reason = not_simulated or _obstacle(rows, parameters)
        if reason is not None:
            tests.append(HypothesisTest.not_run(NULL, rows.joint, reason, alpha))
            continue
        difference = rows.prediction(parameters) - rows.instruments @ parameters[rows.columns]
        fit = regress_coloured(difference, rows.instruments, rows.runs)
        fits.append((rows, fit))
        tests.append(_test_of_joint(rows, fit, parameters, alpha))
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


def _test_of_joint(
    rows: JointRows, fit: ColouredRegression, parameters: FloatArray, alpha: float
) -> HypothesisTest:
    energy = torque_deviation(fit.coefficients, fit.covariance_root, rows.instruments)
    return _fisher_test(
        rows.joint,
        fit.whitened,
        fit.n_rows,
        largest_deviation(_both(rows), fit.n_rows),
        100.0 * float(np.sqrt(energy) / np.linalg.norm(rows.prediction(parameters))),
        alpha,
    )


def _test_of_all(
    fits: Sequence[tuple[JointRows, ColouredRegression]], parameters: FloatArray, alpha: float
) -> HypothesisTest:
    """Stack the whitened joints, each divided by its σ of v, with one δ for all."""
    width = len(parameters)
    n_rows = sum(fit.n_rows for _, fit in fits)
    whitened, both = [], []
    for rows, fit in fits:
        sigma = np.sqrt(fit.variance)
        places = np.append(rows.columns, width)
        whitened.append(spread(fit.whitened / sigma, places, width + 1))
        places = np.concatenate([rows.columns, rows.columns + width])
        both.append(spread(_both(rows) / sigma, places, 2 * width))
    stacked = triangle(np.vstack(whitened))
    basis = independent_basis(stacked[:, :-1])
    delta, root = basis.solve(stacked[:, -1], width), basis.inverse_root(width)
    shares = []
    for rows, _ in fits:
        energy = torque_deviation(delta[rows.columns], root[rows.columns], rows.instruments)
        prediction = rows.prediction(parameters)
        shares.append(energy / float(prediction @ prediction))
    return _fisher_test(
        "all",
        stacked,
        n_rows,
        largest_deviation(triangle(np.vstack(both)), n_rows),
        100.0 * float(np.sqrt(np.mean(shares))),
        alpha,
    )


def _both(rows: JointRows) -> FloatArray:
    return triangle(np.hstack([rows.instruments, rows.regressor]))


def _fisher_test(
    scope: str,
    reduced: FloatArray,
    n_rows: int,
    deviation: float | None,
    torque_percent: float,
    alpha: float,
) -> HypothesisTest:
    """F-test of δ = 0 from the triangle of the whitened [Z, (X − Z) β̂]."""
    basis = independent_basis(reduced[:, :-1])
    projection = basis.vectors.T @ reduced[:, -1]
    rest = basis.remove(reduced[:, -1])
    rank, dof = basis.rank, n_rows - basis.rank
    unexplained = float(rest @ rest)
    if rank == 0 or dof <= 0 or unexplained <= 0.0:
        return HypothesisTest.not_run(NULL, scope, "no error V is left to judge by", alpha)
    statistic = float(projection @ projection) / rank / (unexplained / dof)
    p_value = float(fisher.sf(statistic, rank, dof))
    return HypothesisTest(
        NULL,
        scope,
        statistic,
        rank,
        dof,
        p_value,
        deviation,
        alpha,
        torque_deviation_percent=torque_percent,
    )
