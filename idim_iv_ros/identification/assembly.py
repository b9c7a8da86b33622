"""From estimates and tests to the result that is saved and shown."""

import platform
from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.estimation.covariance import AutocorrelatedCovariance
from idim_iv_ros.estimation.essential import essential_parameters
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate
from idim_iv_ros.estimation.least_squares import LinearEstimate, condition_number
from idim_iv_ros.estimation.refined import RefinedIdimIv
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.estimation.sources import InstrumentSources
from idim_iv_ros.identification.estimates import Estimates, estimated_parameters
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.identification.result import (
    BagSummary,
    Fit,
    FittedGain,
    IdentificationResult,
    InstrumentReport,
    JointSeries,
    ProcessingSummary,
    Refined,
    RefinedEstimate,
)
from idim_iv_ros.identification.validate import Validation
from idim_iv_ros.statistics import HypothesisTest, OverallVerdict, judge_all, judge_joint
from idim_iv_ros.types import FloatArray

Estimator = Literal["idim-iv", "idim-ls"]

_REPORTED = ("idim-iv-ros", "numpy", "scipy", "pin", "numba", "rosbags")


def assemble_result(
    prepared: PreparedRegression, estimates: Estimates, validation: Validation
) -> IdentificationResult:
    """Gather everything that a user is shown."""
    rows, linear, refined = estimates.rows, estimates.linear, estimates.refined
    estimate, sources = estimates.iteration, estimates.sources
    configuration, base = prepared.configuration, prepared.model.base
    count = len(base.columns)
    total = sum(len(joint) for joint in rows)
    essential = essential_parameters(
        refined.values,
        refined.covariance,
        total,
        alpha=configuration.identification.significance,
    )
    covariance = AutocorrelatedCovariance(rows, linear.sigma, validation.models, count)
    verdicts = tuple(
        judge_joint(test, residual, _of_joint(validation.specification, residual.joint))
        for test, residual in zip(validation.tests[1:], validation.residuals, strict=True)
    )
    coloured = any(residual.white is False for residual in validation.residuals)
    return IdentificationResult(
        robot=prepared.model.robot.name,
        joints=tuple(configuration.robot.joints),
        joint_types=prepared.model.robot.joint_types,
        effort_unit=configuration.signals.effort_unit,
        bags=_bags(prepared),
        software=_software(),
        configuration=configuration.model_dump(mode="json", exclude_none=True),
        estimator=estimates.estimator,
        iterations=1 if estimate is None else len(estimate.steps) + 1,
        converged=estimate is None or estimate.converged,
        convergence_note=_convergence(estimate, base.names, configuration),
        parameters=estimated_parameters(prepared, estimates, covariance, essential),
        covariance=covariance.matrix,
        instruments=_instruments(estimate, validation, configuration),
        residuals=validation.residuals,
        verdicts=verdicts,
        verdict=_overall(judge_all(verdicts, validation.tests[0]), estimate),
        fit=Fit(
            relative_error_percent=_relative_error(rows, linear),
            ls_relative_error_percent=_relative_error(rows, estimates.weighted),
            condition_number=condition_number(rows, count),
            samples=total,
            base_parameters=count,
            essential_parameters=len(essential.columns),
            essential_p_value=essential.p_value,
            joint_relative_error_percent={
                name: _relative_error_of(residual, joint.torque)
                for name, residual, joint in zip(
                    configuration.robot.joints, linear.residuals, rows, strict=True
                )
            },
        ),
        processing=ProcessingSummary(
            position_cutoff=prepared.cutoffs.position,
            position_order=configuration.processing.position_order,
            decimation_cutoff=prepared.cutoffs.decimation,
            decimation_factors=prepared.cutoffs.factors,
            row_rate=prepared.cutoffs.row_rate,
            minimum_speed=tuple(float(speed) for speed in prepared.minimum_speed),
            reasons=prepared.doubts + prepared.reasons + prepared.advice,
            advice=prepared.advice,
        ),
        controller=() if sources is None else sources.controller,
        fitted_gains=() if sources is None else _fitted_gains(sources, configuration),
        refined=_refined(prepared, refined, essential.columns) if coloured else None,
        series=_series(prepared, rows, linear),
        doubts=prepared.doubts,
    )


def _refined(
    prepared: PreparedRegression, refined: RefinedIdimIv, essential: NDArray[np.int64]
) -> Refined:
    base = prepared.model.base
    std = np.sqrt(np.diag(refined.covariance))
    return Refined(
        ar_orders=tuple(model.order for model in refined.models),
        parameters=tuple(
            RefinedEstimate(
                base.names[k],
                base.expressions[k],
                base.units[k],
                float(refined.values[k]),
                float(std[k]),
                k in essential,
            )
            for k in range(len(base.columns))
        ),
    )


def _instruments(
    estimate: IdimIvEstimate | None, validation: Validation, configuration: Configuration
) -> InstrumentReport:
    outcomes = [test.accepted for test in validation.tests]
    accepted = False if False in outcomes else None if None in outcomes else True
    note = "" if estimate is None else estimate.instruments.note
    return InstrumentReport(
        source="none: least squares" if estimate is None else estimate.source.name,
        accepted=accepted,
        alpha=configuration.identification.significance,
        failures=() if estimate is None else estimate.failures,
        notes=tuple(each for each in (note, validation.note) if each),
        tests=validation.tests,
        exogeneity=validation.exogeneity,
        specification=validation.specification,
    )


def _of_joint(tests: Sequence[HypothesisTest], joint: str) -> tuple[HypothesisTest, ...]:
    return tuple(test for test in tests if test.scope.rpartition(": ")[0] == joint)


def _overall(verdict: OverallVerdict, estimate: IdimIvEstimate | None) -> OverallVerdict:
    """Say so where the loop could not be simulated with the estimates: a wrong model does that."""
    if estimate is None or not estimate.failures:
        return verdict
    failure = estimate.failures[0]
    sentence = f"{verdict.sentence} Tried first, and failed: {failure}."
    return replace(verdict, sentence=sentence)


def _convergence(
    estimate: IdimIvEstimate | None, names: tuple[str, ...], configuration: Configuration
) -> str:
    if estimate is None:
        return "least squares needs no iteration"
    if not estimate.steps:
        return "the instruments do not depend on the parameters: one step"
    last = estimate.steps[-1]
    moved = f"{names[last.parameter]} moved last, by {100.0 * last.change:.2g} %"
    tolerance = 100.0 * configuration.identification.tolerance
    if estimate.converged:
        return f"{moved} (tolerance {tolerance:g} %)"
    return f"not converged: {moved}, more than {tolerance:g} %"


def _relative_error(rows: Sequence[JointRows], linear: LinearEstimate) -> float:
    error = sum(float(residual @ residual) for residual in linear.residuals)
    torque = sum(float(joint.torque @ joint.torque) for joint in rows)
    return 100.0 * float(np.sqrt(error / torque)) if torque > 0.0 else float("nan")


def _relative_error_of(residual: FloatArray, torque: FloatArray) -> float | None:
    """Of one joint, %; None without torque."""
    size = float(np.linalg.norm(torque))
    return 100.0 * float(np.linalg.norm(residual)) / size if size > 0.0 else None


def _fitted_gains(
    sources: InstrumentSources, configuration: Configuration
) -> tuple[FittedGain, ...]:
    return tuple(
        FittedGain(
            joint,
            term,
            float(fit.gains[row, column]),
            float(fit.std[row, column]),
            float(fit.r_squared[row]),
        )
        for fit in sources.fits
        for row, joint in enumerate(configuration.robot.joints)
        for column, term in enumerate(fit.terms)
        if fit.included[row, column]
    )


def _bags(prepared: PreparedRegression) -> tuple[BagSummary, ...]:
    bags = []
    session = prepared.session
    parts = zip(session.recordings, session.parts, prepared.motions, strict=True)
    for recording, part, motion in parts:
        signals = (
            recording.position,
            recording.effort,
            recording.velocity,
            recording.position_reference,
            recording.velocity_reference,
        )
        bags.append(
            BagSummary(
                path=str(recording.path),
                rate=recording.rate,
                duration=recording.duration,
                session_start=part.start,
                samples=recording.samples,
                signals=tuple(signal.origin for signal in signals if signal is not None),
                clocks=recording.clocks,
                notes=recording.notes,
                dropped=motion.dropped,
                frozen=recording.frozen,
            )
        )
    return tuple(bags)


def _series(
    prepared: PreparedRegression, rows: Sequence[JointRows], linear: LinearEstimate
) -> tuple[JointSeries, ...]:
    """Measured and predicted torque of the rows that count, over the time of the session."""
    series = []
    for joint, (own, residual) in enumerate(zip(rows, linear.residuals, strict=True)):
        time = [
            part.start + motion.time[motion.kept[:, joint]]
            for part, motion in zip(prepared.session.parts, prepared.motions, strict=True)
        ]
        series.append(
            JointSeries(own.name, np.concatenate(time), own.torque, own.torque - residual)
        )
    return tuple(series)


def _software() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for package in _REPORTED:
        versions[package] = metadata.version(package)
    return versions
