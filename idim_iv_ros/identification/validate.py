"""Tests and residual analysis of one estimate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.estimation.covariance import WhiteCovariance
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.estimation.least_squares import LinearEstimate
from idim_iv_ros.estimation.rows import JointRows, with_instruments
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.identification.tested_rows import functions_of_motion, tested_rows
from idim_iv_ros.signals import AutoregressiveModel, torque_noise
from idim_iv_ros.statistics import (
    HypothesisTest,
    ResidualDiagnosis,
    diagnose_residual,
    exogeneity_test,
    specification_tests,
    wald_test_of_instruments,
)
from idim_iv_ros.statistics.motion_functions import FAMILIES
from idim_iv_ros.types import FloatArray

# A residual of up to this many times the measurement noise passes for noise when the uncertainty
# of the simulation's parameters is judged; what is beyond that is the model's own error.
_LARGEST_NOISE = 3.0

NO_INSTRUMENTS = "IDIM-LS uses no instruments"


@dataclass(frozen=True)
class Validation:
    """What the tests say of one estimate; see `IdentificationResult` for its parts."""

    tests: tuple[HypothesisTest, ...]
    exogeneity: tuple[HypothesisTest, ...]
    specification: tuple[HypothesisTest, ...]
    residuals: tuple[ResidualDiagnosis, ...]
    models: tuple[AutoregressiveModel, ...]
    note: str


def validate(
    prepared: PreparedRegression,
    observed: Sequence[JointRows],
    linear: LinearEstimate,
    estimate: IdimIvEstimate | None,
) -> Validation:
    """Run the revised Durbin-Wu-Hausman test and the residual analysis (paper, section IV).

    Parameters
    ----------
    observed
        The rows that count, with the instruments of the estimate.
    linear
        The estimate that is judged.
    estimate
        The IDIM-IV iteration, None for IDIM-LS.
    """
    configuration = prepared.configuration
    alpha = configuration.identification.significance
    joints = configuration.robot.joints
    rows: Sequence[JointRows] = observed
    residuals = tuple(diagnose_residual(joint, linear.values, alpha=alpha) for joint in rows)
    reason: str | None = NO_INSTRUMENTS
    if estimate is not None:
        reason = estimate.source.testable or estimate.instruments.untestable
    errors, candidates, note = None, _no_functions(len(joints)), ""
    if estimate is not None and reason is None:
        tested = tested_rows(prepared, observed, estimate)
        rows = with_instruments(tested.rows, tested.instruments.matrices)
        noise = np.minimum(linear.sigma, _LARGEST_NOISE * torque_noise(prepared.motions))
        own = [joint.with_instruments(joint.matrix) for joint in observed]
        covariance = WhiteCovariance(own, noise, len(linear.values)).matrix
        errors = tested.source.prediction_errors(linear.values, covariance)
        candidates = functions_of_motion(tested, prepared.model.robot.joint_types)
        note = tested.note
    tests = wald_test_of_instruments(
        rows, linear.values, alpha=alpha, not_simulated=reason, simulation_errors=errors
    )
    exogeneity = exogeneity_test(rows, linear.values, alpha=alpha, not_simulated=reason)
    return Validation(
        tests=_together(tests),
        exogeneity=_together(exogeneity),
        specification=specification_tests(
            rows, linear.values, candidates, alpha=alpha, not_simulated=reason
        ),
        residuals=residuals,
        models=tuple(residual.autoregression for residual in residuals),
        note=note,
    )


def _no_functions(joints: int) -> list[dict[str, FloatArray]]:
    return [{family: np.zeros((0, 0)) for family in FAMILIES} for _ in range(joints)]


def _together(tests: tuple[HypothesisTest, ...]) -> tuple[HypothesisTest, ...]:
    """Share α: half for all rows, half among the n joints (Bonferroni).

    A right model is then accused anywhere with probability α at most.
    """
    joints = max(len(tests) - 1, 1)
    first, others = tests[0], tests[1:]
    return (
        replace(first, alpha=first.alpha / 2.0),
        *(replace(test, alpha=test.alpha / (2.0 * joints)) for test in others),
    )
