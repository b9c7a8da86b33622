"""The revised Durbin-Wu-Hausman test: are the instruments valid?  H0: Π = I in X = Z Π + V.

Π has b × b entries, 3,600 for the TX40: no recording can test them all. What counts is the torque.
Π = I says that the prediction X β̂ with the measured motion, regressed on Z, gives β̂ back; so (X −
Z) β̂ = Z δ + v is fitted and δ = 0 tested, an F-test of as many restrictions as there are columns,
on rows whitened by the autoregressive model of v, which is not that of the residual of the torque.

The other half of the test asks whether X is exogenous, so that least squares would do as well:
augmented regression y = X β + V̂ γ + e with V̂ = X − Z Π̂, H0: γ = 0, F(b_v, r − b − b_v).
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.estimation.least_squares import stacked_with_instruments
from idim_iv_ros.estimation.qr import independent_basis, r_factor, stacked_r_factor
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.statistics.gls import GlsRegression, gls_regression
from idim_iv_ros.statistics.hypothesis import HypothesisTest, f_test
from idim_iv_ros.types import FloatArray

VALID = "the instruments are valid (Π = I)"
EXOGENOUS = "the regressor is exogenous (γ = 0)"
_ROWS_PER_COLUMN = 5
_EQUAL = 1e-10
LARGEST_STANDARD_ERROR = 0.05


def wald_test_of_instruments(
    joints: Sequence[JointRows],
    parameters: FloatArray,
    simulation_errors: Sequence[FloatArray] | None = None,
) -> tuple[HypothesisTest, ...]:
    """Test the instruments for all rows and joint by joint (paper, equation 10).

    - `joints`: unfiltered rows, whose instruments come from a simulation of the loop: others share
      the noise of X by construction
    - `simulation_errors`: sequence of (r_j, n_draws), draws of the change of Z β̂ that comes from
      the uncertainty of the parameters of the simulation; None: these are taken as known

    Returns tests of scope "all" first, then one for each joint in the order given.
    `max_deviation` is that of `largest_deviation`; `torque_deviation_percent` is 100 ‖Z δ̂‖ / ‖X
    β̂‖ less what noise alone would give (for "all": root mean square over the joints).
    """
    fits: list[tuple[JointRows, GlsRegression, FloatArray]] = []
    tests: list[HypothesisTest] = []
    draws = simulation_errors or [np.zeros((len(rows.torque), 0)) for rows in joints]
    for rows, errors in zip(joints, draws, strict=True):
        predicted = rows.prediction(parameters)
        difference = predicted - rows.instruments @ parameters[rows.columns]
        reason = _obstacle(rows, predicted, difference)
        if reason is not None:
            tests.append(HypothesisTest.not_run(VALID, rows.name, reason))
            continue
        fit = gls_regression(difference, rows.instruments, rows.segments)
        columns = np.column_stack([rows.instruments, difference, errors])
        whitened = r_factor(fit.errors.whiten(columns, rows.segments))
        fits.append((rows, fit, whitened))
        shape = len(difference), len(rows.columns)
        largest = largest_deviation(rows.instrumental_r_factor[:, :-1], len(difference))
        percent = _torque_percent(rows, parameters, fit.coefficients, fit.covariance_root)
        tests.append(_satterthwaite_f_test(rows.name, whitened, shape, largest, percent))
    if fits:
        return (_test_of_all(fits, parameters), *tests)
    reasons = {test.reason or "" for test in tests}
    reason = reasons.pop() if len(reasons) == 1 else "no joint can be tested"
    return (HypothesisTest.not_run(VALID, "all", reason), *tests)


def _obstacle(rows: JointRows, predicted: FloatArray, difference: FloatArray) -> str | None:
    """Why the instruments of a joint cannot be tested by X β̂ and (X − Z) β̂ (r,), or None."""
    n_rows, width = rows.instruments.shape
    if width == 0:
        return "no parameter acts on this joint"
    if n_rows < _ROWS_PER_COLUMN * width:
        return f"{n_rows} rows for {width} columns are too few"
    if not np.any(predicted):
        return "the model predicts no torque"
    if np.linalg.norm(difference) <= _EQUAL * np.linalg.norm(predicted):
        return "the instruments equal the regressor, so there is no error V to test"
    return None


def _test_of_all(
    fits: Sequence[tuple[JointRows, GlsRegression, FloatArray]], parameters: FloatArray
) -> HypothesisTest:
    """Stack the whitened joints, each divided by its σ of v, with one δ for all.

    `fits`: of each joint its rows, the regression of v on Z, and the R factor of the whitened
    [Z, (X − Z) β̂, draws].
    """
    joints, width = [rows for rows, _, _ in fits], len(parameters)
    n_rows = sum(len(rows.torque) for rows in joints)
    sigma = np.sqrt([fit.variance for _, fit, _ in fits])
    more = fits[0][2].shape[1] - len(joints[0].columns)
    stacked = stacked_r_factor(
        [factor / deviation for (_, _, factor), deviation in zip(fits, sigma, strict=True)],
        [np.append(rows.columns, np.arange(width, width + more)) for rows in joints],
        width + more,
    )
    basis = independent_basis(stacked[:, :width])
    delta, root = basis.solve(stacked[:, width], width), basis.inverse_root(width)
    parts = [(rows, delta[rows.columns], root[rows.columns]) for rows in joints]
    percents = [_torque_percent(rows, parameters, *solution) for rows, *solution in parts]
    largest = largest_deviation(stacked_with_instruments(joints, width, sigma)[:, :-1], n_rows)
    percent = float(np.sqrt(np.mean(np.square(percents))))
    return _satterthwaite_f_test("all", stacked, (n_rows, width), largest, percent)


def _satterthwaite_f_test(
    scope: str,
    factor: FloatArray,
    shape: tuple[int, int],
    deviation: float | None,
    torque_percent: float,
) -> HypothesisTest:
    """F-test of δ = 0 from the R factor of the whitened [Z, (X − Z) β̂, draws]; `shape` is Z's.

    Without draws Q = ‖P_Z (X − Z) β̂‖² is σ² χ²(b) under the null hypothesis. With them its
    covariance on the span of Z is σ² I + A, A that of the draws; Q is then compared with the
    scaled χ² of the same mean and variance (Satterthwaite), 2 tr (σ² I + A)².
    """
    n_rows, width = shape
    basis = independent_basis(factor[:, :width])
    projection, rest = basis.vectors.T @ factor[:, width], basis.remove(factor[:, width])
    rank, dof = basis.rank, n_rows - basis.rank
    unexplained = float(rest @ rest)
    if rank == 0 or dof <= 0 or unexplained <= 0.0:
        return HypothesisTest.not_run(VALID, scope, "no error V is left to judge by")
    variance = unexplained / dof
    draws = basis.vectors.T @ factor[:, width + 1 :]
    count, trace, trace_of_square = draws.shape[1], 0.0, 0.0
    if count > 1:  # tr A and tr A² of the covariance A of the draws
        products = draws.T @ draws
        trace = float(np.trace(products)) / count
        square = float(np.mean(products[~np.eye(count, dtype=bool)] ** 2))
        trace_of_square = min(max(square, trace**2 / rank), trace**2)
    mean = rank * variance + trace
    spread_of_energy = rank * variance**2 + 2.0 * variance * trace + trace_of_square
    freedom = max(1, round(mean**2 / spread_of_energy))
    # Scaled to a sum of `freedom` squares of the noise's variance.
    scaled = float(projection @ projection) * variance * freedom / mean
    return f_test(VALID, scope, (scaled, freedom), (unexplained, dof), torque_percent, deviation)


def largest_deviation(factor: FloatArray, n_rows: int) -> float | None:
    """Largest |Π̂ − I| without units, over the entries that the rows determine.

    Entry (k, i) of the least squares estimate Π̂ is scaled by rms(Z_k)/rms(X_i), so that it is what
    of column i, in parts of its rms, goes with column k beyond Π = I. Entries whose standard error
    (taken as if rows were white) exceeds 0.05 are left out; None if all do. `factor` (k, 2c): R
    factor of [Z X] of `n_rows` rows.
    """
    width = factor.shape[1] // 2
    instruments, regressor = factor[:, :width], factor[:, width:]
    basis = independent_basis(instruments)
    seen = np.flatnonzero(np.linalg.norm(regressor, axis=0) > 0.0)
    dof = n_rows - basis.rank
    if basis.rank == 0 or len(seen) == 0 or dof <= 0:
        return None
    regressor, kept = regressor[:, seen], basis.kept
    sizes = np.linalg.norm(instruments[:, kept], axis=0)
    to_unit = sizes[:, None] / np.linalg.norm(regressor, axis=0)
    difference = basis.solve(regressor - instruments[:, seen], width)[kept]
    spread_of_row = np.linalg.norm(np.linalg.inv(basis.upper), axis=1)
    noise = np.linalg.norm(basis.remove(regressor), axis=0) / np.sqrt(dof)
    entries = np.abs(difference) * to_unit
    determined = np.outer(spread_of_row, noise) * to_unit <= LARGEST_STANDARD_ERROR
    return float(entries[determined].max()) if determined.any() else None


def _torque_percent(
    rows: JointRows, parameters: FloatArray, coefficients: FloatArray, covariance_root: FloatArray
) -> float:
    """100 ‖Z δ̂‖ / ‖X β̂‖ of unfiltered rows, ‖Z δ̂‖² less its expectation under δ = 0, at least 0.

    `coefficients` (c,): δ̂ of (X − Z) β̂ = Z δ + v; its covariance is covariance_root (c, k) times
    its transpose.
    """
    explained, by_noise = rows.instruments @ coefficients, rows.instruments @ covariance_root
    energy = max(0.0, float(explained @ explained) - float(np.vdot(by_noise, by_noise)))
    return 100.0 * float(np.sqrt(energy) / np.linalg.norm(rows.prediction(parameters)))


def exogeneity_test(
    joints: Sequence[JointRows], parameters: FloatArray
) -> tuple[HypothesisTest, ...]:
    """Test whether X is exogenous, for all rows and joint by joint; see `wald_test_of_instruments`.

    The rows of each joint are whitened by the autoregressive model of its IV residual first, and
    for "all" divided by the σ of the whitened residual. With instruments that do not come from a
    simulation V̂ is not the error of X.
    """
    whitened, sigmas, tests = [], [], []
    for rows in joints:
        # The residual has lost what estimating β took out of it; a filter fitted on it alone
        # made a true hypothesis fail 45 % of the time with 45 columns in 250 rows.
        model = gls_regression(rows.residual(parameters), rows.matrix, rows.segments).errors
        white = rows.whitened(model).reduced
        tests.append(exogeneity_f_test(white.instrumental_r_factor, len(rows), rows.name))
        sigma = float(np.linalg.norm(white.residual(parameters)) / np.sqrt(max(1, len(rows))))
        if sigma > 0.0:
            whitened.append(white)
            sigmas.append(sigma)
    if not whitened:
        return (HypothesisTest.not_run(EXOGENOUS, "all", "there is no residual"), *tests)
    whole = stacked_with_instruments(whitened, len(parameters), np.array(sigmas))
    return (exogeneity_f_test(whole, sum(map(len, whitened)), "all"), *tests)


def exogeneity_f_test(factor: FloatArray, n_rows: int, scope: str) -> HypothesisTest:
    """F-test of γ = 0 from the R factor of [Z X y], equal to the Wu-Hausman statistic.

    Columns of V̂ that vanish, or that the other columns of [X V̂] already hold, are dropped by QR,
    each measured against the norm of its column of X. `factor` (k, 2c + 1): of `n_rows` rows, which
    may be weighted and whitened; `scope`: "all" or the name of a joint.
    """
    width = (factor.shape[1] - 1) // 2
    instruments, regressor, torque = factor[:, :width], factor[:, width:-1], factor[:, -1]
    error = independent_basis(instruments).remove(regressor)
    span = independent_basis(regressor)
    augmented = independent_basis(span.remove(error), np.linalg.norm(regressor, axis=0))
    if augmented.rank == 0:
        reason = "the instruments reproduce the regressor, which is exogenous"
        return HypothesisTest.not_run(EXOGENOUS, scope, reason)
    dof = n_rows - span.rank - augmented.rank
    if dof <= 0:
        columns = span.rank + augmented.rank
        reason = f"{n_rows} rows for {columns} columns are too few"
        return HypothesisTest.not_run(EXOGENOUS, scope, reason)
    restricted = span.remove(torque)
    free = augmented.remove(restricted)
    unexplained = float(free @ free)
    if unexplained <= np.finfo(float).eps * float(torque @ torque):
        return HypothesisTest.not_run(EXOGENOUS, scope, "the residual vanishes")
    gained = augmented.vectors.T @ restricted
    return f_test(EXOGENOUS, scope, (float(gained @ gained), augmented.rank), (unexplained, dof))
