"""Does the residual still follow the motion?  F-test of the model's specification (RESET).

The instruments say whether the *motion* is simulated well. A stiff loop, above all one with
integral action, holds the motion to its reference whatever the model is, and the error stays in
the torque alone. So the residual is regressed on functions of the simulated motion that the
model does not hold: H0: E(ε | simulated motion) = 0. This is Ramsey's RESET with simulated
regressors for the sake of exogeneity, and instead of powers of the fit with functions in families
as an engineer would name what is missing: *position* (gravity, springs, ripple), *speed* (shape of
the friction), *acceleration* (inertia, couplings between joints). Rows are whitened by the
autoregressive model of the residual.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations

import numpy as np

from idim_iv_ros.estimation.qr import independent_basis
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.statistics.gls import gls_regression_from_rest
from idim_iv_ros.statistics.hypothesis import HypothesisTest, f_test
from idim_iv_ros.types import FloatArray

POSITION, SPEED, ACCELERATION = FAMILIES = ("position", "speed", "acceleration")
NULL = "nothing of the {family} is left in the residual"

_ROWS_PER_DIRECTION = 25
_MOST_DIRECTIONS = 15
# Of α: with 350 rows and 12 columns of Z a right model was rejected up to five times as often as
# a nominal level of some thousandths says, for the autocorrelation is estimated too.
_CAUTION = 0.1
# Of the largest: a direction with less of the candidates' variation is what the model holds.
_LEAST_VARIATION = 0.02


def shared_functions(
    joint_types: Sequence[str], q: FloatArray, dq: FloatArray, ddq: FloatArray
) -> dict[str, FloatArray]:
    """Functions of the states (n_samples, n_joints), (n_samples, m), the same for every torque.

    *position*: cos and sin of every joint (position and its square for a prismatic one), and their
    products for every pair. *acceleration*: of every joint, and all products of two speeds.
    """
    waves = [
        [np.cos(of), np.sin(of)] if kind == "revolute" else [of, of**2]
        for of, kind in zip(q.T, joint_types, strict=True)
    ]
    position = list(chain.from_iterable(waves))
    for first, second in combinations(waves, 2):
        position += [a * b for a in first for b in second]
    joints = range(dq.shape[1])
    products = [dq[:, i] * dq[:, k] for i in joints for k in joints if i <= k]
    return {POSITION: np.column_stack(position), ACCELERATION: np.column_stack([ddq, *products])}


def speed_functions(joint: int, dq: FloatArray, peak: float) -> FloatArray:
    """Shapes of friction over the speed of one joint, and the direction of every other.

    Powers for either direction, and what decays at 3, 10 and 30 % of the peak speed: Stribeck's
    shape at several widths. `peak` in rad/s (m/s).
    """
    relative = dq[:, joint] / peak
    share, sign = np.abs(relative), np.sign(relative)
    functions = [sign, relative, share, relative * share, share**2, relative * share**2]
    functions += [sign * np.exp(-share / level) for level in (0.03, 0.1, 0.3)]
    return np.column_stack([*functions, np.sign(np.delete(dq, joint, axis=1))])


def specification_tests(
    joints: Sequence[JointRows],
    parameters: FloatArray,
    candidates: Sequence[Mapping[str, FloatArray]],
    *,
    alpha: float = 0.05,
) -> tuple[tuple[HypothesisTest, ...], ...]:
    """Test the residual of each joint against each family of functions of the motion.

    - `candidates`: one mapping for each joint, family to (r_j, m) functions of the simulated motion
    - `alpha`: probability that a right model is accused anywhere; each test is at a tenth of α over
      their number, because the autocorrelation of the residual is estimated

    Returns tests of scope ``joint: family`` for each joint, with what the functions explain of the
    residual (rms) less what noise alone would give, in percent of the torque.
    """
    tests = [
        [_test(rows, parameters, family, functions) for family, functions in families.items()]
        for rows, families in zip(joints, candidates, strict=True)
    ]
    run = max(sum(test.p_value is not None for test in chain(*tests)), 1)
    level = _CAUTION * alpha / run
    return tuple(tuple(replace(test, alpha=level) for test in of_joint) for of_joint in tests)


def tests_not_run(joint: str, reason: str, alpha: float) -> tuple[HypothesisTest, ...]:
    """Return the tests of a joint for which there is no simulated motion, with the reason."""
    scopes = {NULL.format(family=family): f"{joint}: {family}" for family in FAMILIES}
    level = _CAUTION * alpha
    return tuple(HypothesisTest.not_run(null, at, reason, level) for null, at in scopes.items())


def _test(
    rows: JointRows, parameters: FloatArray, family: str, functions: FloatArray
) -> HypothesisTest:
    scope, null = f"{rows.name}: {family}", NULL.format(family=family)
    residual = rows.residual(parameters)
    beyond, spare = _directions(rows.instruments, functions)
    width = beyond.shape[1]
    if width == 0:
        few = f"{len(residual)} rows for {rows.instruments.shape[1]} columns are too few"
        return HypothesisTest.not_run(null, scope, "the model holds all of them" if spare else few)
    if not np.any(residual):
        return HypothesisTest.not_run(null, scope, "the residual vanishes")
    both = np.column_stack([rows.instruments, beyond])
    fit = gls_regression_from_rest(residual, both, rows.segments)
    instruments = independent_basis(fit.whitened[:, : -width - 1])
    added = independent_basis(instruments.remove(fit.whitened[:, -width - 1 : -1]))
    left = instruments.remove(fit.whitened[:, -1])
    gained, rest = added.vectors.T @ left, added.remove(left)
    dof = len(residual) - instruments.rank - added.rank
    unexplained = float(rest @ rest)
    if added.rank == 0 or dof <= 0 or unexplained <= 0.0:
        return HypothesisTest.not_run(null, scope, "nothing is left to judge by")
    explained = float(np.linalg.norm(beyond @ added.solve(left, width))) ** 2
    noise = unexplained / dof * float(np.linalg.norm(beyond @ added.inverse_root(width))) ** 2
    torque = float(rows.torque @ rows.torque)
    percent = 100.0 * float(np.sqrt(max(explained - noise, 0.0) / torque))
    return f_test(null, scope, (float(gained @ gained), added.rank), (unexplained, dof), percent)


def _directions(instruments: FloatArray, functions: FloatArray) -> tuple[FloatArray, int]:
    """Principal directions of the functions beyond the span of Z, (r, k), and how many may be.

    k is as many as the rows can judge, those with the most variation first.
    """
    count, width = instruments.shape
    spare = min((count - width) // _ROWS_PER_DIRECTION, _MOST_DIRECTIONS)
    if spare <= 0 or functions.shape[1] == 0:
        return np.zeros((count, 0)), max(spare, 0)
    centred = functions - functions.mean(axis=0)
    norms = np.linalg.norm(centred, axis=0)
    moving = norms > 1e-9 * np.linalg.norm(functions, axis=0).max()
    if not moving.any():
        return np.zeros((count, 0)), spare
    scaled = centred[:, moving] / norms[moving]
    beyond = independent_basis(instruments).remove(scaled)
    values, vectors = np.linalg.eigh(beyond.T @ beyond)
    order = np.argsort(values)[::-1][:spare]
    order = order[values[order] > _LEAST_VARIATION**2 * float(np.sum(moving))]
    return np.asarray(beyond @ vectors[:, order]), spare
