"""From estimates and tests to the result that is saved and shown."""

import platform
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from itertools import chain

import numpy as np

from idim_iv_ros.configuration import Configuration
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate, RefinedIdimIv
from idim_iv_ros.estimation.least_squares import (
    AutocorrelatedCovariance,
    LinearEstimate,
    condition_number,
    essential_parameters,
    solve_instrumental_variables,
    solve_least_squares,
    white_covariance,
)
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.estimation.sources import InstrumentSources
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.identification.result import (
    BagSummary,
    Estimator,
    Fit,
    FittedGain,
    IdentificationResult,
    InstrumentReport,
    JointResidual,
    JointSeries,
    JointTests,
    ParameterEstimate,
    ProcessingSummary,
    Refined,
    RefinedEstimate,
)
from idim_iv_ros.identification.validate import Validation
from idim_iv_ros.model import kinematics_digest
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.signals import fit_autoregression, torque_noise
from idim_iv_ros.statistics.drift import in_deviations
from idim_iv_ros.statistics.residuals import mean_square_freedom
from idim_iv_ros.statistics.verdict import judge_all, judge_joint
from idim_iv_ros.types import IntArray

_REPORTED = ("idim-iv-ros", "numpy", "scipy", "pin", "numba", "rosbags")
# Standard deviations of the difference beyond which whitening has moved an estimate further than
# noise does.
_FAR_APART = 3.0


@dataclass(frozen=True)
class Identified:
    """All estimates and tests of an identification, with the rows that they are made of.

    `linear`: the one that is reported; `weighted`: joint-weighted IDIM-LS; `iteration`, `sources`:
    None for IDIM-LS.
    """

    prepared: PreparedRegression
    estimator: Estimator
    rows: Sequence[JointRows]
    linear: LinearEstimate
    weighted: LinearEstimate
    iteration: IdimIvEstimate | None
    sources: InstrumentSources | None
    validation: Validation
    refined: RefinedIdimIv


def assemble_result(
    identified: Identified, physical: tuple[PhysicalParameters | None, str] = (None, "")
) -> IdentificationResult:
    """Gather all that a user is shown of an identification in its result."""
    prepared, validation = identified.prepared, identified.validation
    rows, linear, refined = identified.rows, identified.linear, identified.refined
    estimate, sources = identified.iteration, identified.sources
    configuration, base = prepared.configuration, prepared.model.base
    count = len(base.columns)
    total = sum(len(joint) for joint in rows)
    alpha = configuration.identification.significance
    essential, p_value = essential_parameters(
        refined.values, refined.covariance, total, alpha=alpha
    )
    covariance = AutocorrelatedCovariance(rows, linear.sigma, validation.models, count)
    parameters = _parameters(identified, covariance, essential)
    verdicts = tuple(
        judge_joint(test, residual, specification, float(noise))
        for test, residual, specification, noise in zip(
            validation.tests[1:],
            validation.residuals,
            validation.specification,
            torque_noise(prepared.motions),
            strict=True,
        )
    )
    overall = judge_all(verdicts, validation.tests[0])
    failures = () if estimate is None else estimate.failures
    if failures:
        # The loop could not be simulated with the estimates: a wrong model does that.
        sentence = f"{overall.sentence} Tried first, and failed: {failures[0]}."
        overall = replace(overall, sentence=sentence)
    note = "" if estimate is None else estimate.instruments.note
    outcomes = [test.accepted for test in validation.tests]
    autocorrelated = any(residual.white is False for residual in validation.residuals)
    series = _series(prepared, rows, linear)
    return IdentificationResult(
        robot=prepared.model.robot.name,
        joints=tuple(configuration.robot.joints),
        joint_types=prepared.model.robot.joint_types,
        effort_unit=configuration.signals.effort_unit,
        bags=_bags(prepared),
        software={"python": platform.python_version(), **software_versions()},
        configuration=configuration.model_dump(mode="json", exclude_none=True),
        estimator=identified.estimator,
        iterations=1 if estimate is None else len(estimate.steps) + 1,
        converged=estimate is None or estimate.converged,
        convergence_note=_convergence(estimate, base.names, configuration),
        parameters=parameters,
        covariance=covariance.matrix,
        instruments=InstrumentReport(
            accepted=False if False in outcomes else None if None in outcomes else True,
            alpha=alpha,
            source="none: least squares" if estimate is None else estimate.source.name,
            failures=failures,
            notes=tuple(text for text in (note, validation.note) if text),
            tests=validation.tests,
        ),
        specification=JointTests(
            alpha=alpha, tests=tuple(chain.from_iterable(validation.specification))
        ),
        exogeneity=JointTests(alpha=alpha, tests=validation.exogeneity),
        residuals=tuple(
            JointResidual(
                **vars(residual),
                verdict=verdict.verdict,
                sentence=verdict.sentence,
                rows=len(joint.time),
                mean_square_freedom=mean_square_freedom(
                    joint.time, joint.measured - joint.predicted
                ),
            )
            for residual, verdict, joint in zip(validation.residuals, verdicts, series, strict=True)
        ),
        verdict=overall,
        fit=Fit(
            relative_error_percent=_relative_error(rows, linear),
            ls_relative_error_percent=_relative_error(rows, identified.weighted),
            condition_number=condition_number(rows, count),
            samples=total,
            base_parameters=count,
            essential_parameters=len(essential),
            essential_p_value=p_value,
            joint_relative_error_percent={
                residual.joint: residual.relative_percent for residual in validation.residuals
            },
        ),
        processing=ProcessingSummary(
            position_cutoff=prepared.cutoffs.position,
            position_order=configuration.processing.position_order,
            decimation_cutoff=prepared.cutoffs.decimation,
            decimation_factors=prepared.cutoffs.factors,
            row_rate=prepared.cutoffs.row_rate,
            minimum_speed=tuple(float(speed) for speed in prepared.minimum_speed),
            reasons=prepared.warnings + prepared.reasons + prepared.advice,
            advice=prepared.advice,
        ),
        controller=() if sources is None else sources.controller,
        fitted_gains=() if sources is None else _fitted_gains(sources, configuration),
        refined=refined_result(refined, parameters) if autocorrelated else None,
        series=series,
        doubts=prepared.warnings,
        physical=physical[0],
        why_no_physical=physical[1],
        kinematics=kinematics_digest(prepared.model.robot),
    )


def _parameters(
    identified: Identified, covariance: AutocorrelatedCovariance, essential: IntArray
) -> tuple[ParameterEstimate, ...]:
    """Every base parameter with its standard deviations, alone and among the essential ones."""
    base, given = identified.prepared.model.base, identified.prepared.given
    rows, weighted, linear = identified.rows, identified.weighted, identified.linear
    std = np.sqrt(np.diag(covariance.matrix))
    white_std = np.sqrt(np.diag(white_covariance(rows, linear.sigma, len(linear.values))))
    ls_std = std
    if identified.iteration is not None:
        models = [
            fit_autoregression(residual, joint.segments)
            for joint, residual in zip(rows, weighted.residuals, strict=True)
        ]
        observed = [joint.with_instruments(None) for joint in rows]
        ls_covariance = AutocorrelatedCovariance(
            observed, weighted.sigma, models, len(weighted.values)
        )
        ls_std = np.sqrt(np.diag(ls_covariance.matrix))
    ordinary = solve_least_squares(rows, len(base.columns), weighted=False)
    places = {int(column): place for place, column in enumerate(essential)}
    # Estimated again with the essential parameters only, same weights.
    restricted = [joint.reduced.keep(essential) for joint in rows]
    reduced = solve_instrumental_variables(restricted, len(places), linear.sigma).values
    reduced_std = np.sqrt(np.diag(covariance.restricted(essential)))
    return tuple(
        ParameterEstimate(
            name=base.names[k],
            expression=base.expressions[k],
            unit=base.units[k],
            value=float(linear.values[k]),
            std=float(std[k]),
            white_std=float(white_std[k]),
            essential=k in places,
            essential_value=float(reduced[places[k]]) if k in places else None,
            essential_std=float(reduced_std[places[k]]) if k in places else None,
            ls_value=float(weighted.values[k]),
            ls_std=float(ls_std[k]),
            ordinary_ls_value=float(ordinary.values[k]),
            given_value=None if given is None else float(given[k]),
            non_negative=base.non_negative[k],
        )
        for k in range(len(base.columns))
    )


def refined_result(refined: RefinedIdimIv, parameters: Sequence[ParameterEstimate]) -> Refined:
    """Refined estimates, and which of the unrefined ones whitening moves beyond noise."""
    std = np.sqrt(np.diag(refined.covariance))
    estimates = tuple(
        RefinedEstimate(
            name=parameter.name,
            expression=parameter.expression,
            unit=parameter.unit,
            value=float(value),
            std=float(deviation),
            essential=parameter.essential,
            ls_value=parameter.ls_value,
            given_value=parameter.given_value,
        )
        for parameter, value, deviation in zip(parameters, refined.values, std, strict=True)
    )
    # Whitening moves no estimate further than noise does where the model is right.
    moved = tuple(
        parameter.name
        for parameter, other in zip(parameters, estimates, strict=True)
        if parameter.essential
        and abs(in_deviations(parameter.value, parameter.std, other.value, other.std)) > _FAR_APART
    )
    return Refined(tuple(model.order for model in refined.models), estimates, moved)


def _convergence(
    estimate: IdimIvEstimate | None, names: tuple[str, ...], configuration: Configuration
) -> str:
    if estimate is None:
        return "least squares needs no iteration"
    if not estimate.steps:
        return "the instruments do not depend on the parameters: one step"
    change, parameter = estimate.steps[-1]
    moved = f"{names[parameter]} moved last, by {100.0 * change:.2g} %"
    tolerance = 100.0 * configuration.identification.tolerance
    if estimate.converged:
        return f"{moved} (tolerance {tolerance:g} %)"
    return f"not converged: {moved}, more than {tolerance:g} %"


def _relative_error(rows: Sequence[JointRows], linear: LinearEstimate) -> float:
    error = sum(float(residual @ residual) for residual in linear.residuals)
    torque = sum(float(joint.torque @ joint.torque) for joint in rows)
    return 100.0 * float(np.sqrt(error / torque)) if torque > 0.0 else float("nan")


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
    for joint, (of_joint, residual) in enumerate(zip(rows, linear.residuals, strict=True)):
        time = [
            part.start + motion.time[motion.kept[:, joint]]
            for part, motion in zip(prepared.session.parts, prepared.motions, strict=True)
        ]
        series.append(
            JointSeries(
                of_joint.name, np.concatenate(time), of_joint.torque, of_joint.torque - residual
            )
        )
    return tuple(series)


def software_versions() -> dict[str, str]:
    """Versions of the project and of the packages that its numbers depend on."""
    return {package: metadata.version(package) for package in _REPORTED}
