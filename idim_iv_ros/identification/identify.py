"""From recordings to validated parameters: the whole of `idim-iv identify` without its files."""

import platform
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from itertools import chain

import numpy as np

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.idim_iv import IdimIvEstimate, idim_iv, refined_idim_iv
from idim_iv_ros.estimation.instruments import InstrumentSources, instrument_sources
from idim_iv_ros.estimation.least_squares import (
    AutocorrelatedCovariance,
    LinearEstimate,
    condition_number,
    essential_parameters,
    solve_instrumental_variables,
    solve_least_squares,
    white_covariance,
)
from idim_iv_ros.estimation.observation import observation_rows
from idim_iv_ros.estimation.rows import JointRows, with_instruments
from idim_iv_ros.files import FilePaths
from idim_iv_ros.identification import result as results
from idim_iv_ros.identification.prepare import (
    PreparedRegression,
    prepare,
    read_configured,
    require_excitation,
)
from idim_iv_ros.identification.result import Estimator, IdentificationResult
from idim_iv_ros.identification.validate import Validation, validate
from idim_iv_ros.model import kinematics_digest
from idim_iv_ros.physical import PhysicalParameters, nearest_physical
from idim_iv_ros.physical.nearest import TO_INSTALL, Judge
from idim_iv_ros.progress import Progress, Stopwatch, part_of
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.signals.autoregression import fit_autoregression
from idim_iv_ros.signals.motion import torque_noise
from idim_iv_ros.statistics.hypothesis import in_deviations
from idim_iv_ros.statistics.residuals import mean_square_freedom
from idim_iv_ros.statistics.verdict import judge_all, judge_joint
from idim_iv_ros.types import FloatArray, IntArray

_REPORTED = ("idim-iv-ros", "numpy", "scipy", "pin", "numba", "rosbags")
# Standard deviations of the difference beyond which whitening has moved an estimate further than
# noise does.
_FAR_APART = 3.0
# What a refined estimate has in common with the estimate.
_OF_PARAMETER = ("name", "expression", "unit", "essential", "ls_value", "given_value")
_SIGNALS = ("position", "effort", "velocity", "position_reference", "velocity_reference")


@dataclass(frozen=True)
class Identified:
    """All estimates and tests of an identification, with the rows that they are made of.

    `linear`: the one that is reported; `weighted`: joint-weighted IDIM-LS; `iteration`, `sources`:
    None for IDIM-LS; `refined`: estimate (b,) and covariance (b, b).
    """

    prepared: PreparedRegression
    estimator: Estimator
    rows: Sequence[JointRows]
    linear: LinearEstimate
    weighted: LinearEstimate
    iteration: IdimIvEstimate | None
    sources: InstrumentSources | None
    validation: Validation
    refined: tuple[FloatArray, FloatArray]


def identify(
    bags: FilePaths,
    configuration: Configuration,
    *,
    estimator: Estimator = "idim-iv",
    progress: Progress | None = None,
) -> IdentificationResult:
    """Identify a robot from its bags and test whether the answer may be believed.

    Parameters
    ----------
    bags
        One recording or several of one robot, used together: text or paths.
    configuration
        See `load_configuration`.
    estimator
        ``idim-iv``, or ``idim-ls`` for least squares (joint-weighted).
    progress
        Called with a stage in words and the share that is done, 0 to 1.

    Raises
    ------
    UsageError
        The configuration or the URDF is wrong.
    DataError
        The recordings cannot support the answer.
    """
    with one_thread(), Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        recordings = read_configured(bags, configuration, progress)
    result = identify_recordings(recordings, configuration, estimator=estimator, progress=progress)
    return replace(result, timing=watch.timing | result.timing)


def identify_recordings(
    recordings: Recording | Sequence[Recording],
    configuration: Configuration,
    *,
    estimator: Estimator = "idim-iv",
    progress: Progress | None = None,
) -> IdentificationResult:
    """Identify from recordings that were read before; otherwise as `identify`."""
    given = [recordings] if isinstance(recordings, Recording) else list(recordings)
    with one_thread(), Stopwatch(progress) as watch:
        everything = identified(given, configuration, estimator, watch)
        watch.stage("physical parameters", 0.97)
        rows, sigma = everything.rows, everything.linear.sigma
        physical = consistent_parameters(everything.prepared, *everything.refined, rows, sigma)
        result = assemble_result(everything, physical)
    return replace(result, timing=watch.timing)


def identified(
    recordings: Sequence[Recording],
    configuration: Configuration,
    estimator: Estimator,
    watch: Stopwatch,
) -> Identified:
    """Take all steps of an identification but the search for physical parameters."""
    watch.stage("filtering", 0.3)
    prepared = prepare(recordings, configuration)
    watch.stage("regressor", 0.4)
    model, motions = prepared.model, prepared.motions
    rows = observation_rows(model, motions)
    require_excitation(prepared, rows)
    watch.stage("estimation", 0.5)
    parameters = len(model.base.columns)
    estimate, sources = None, None
    if estimator == "idim-ls":
        linear = weighted = solve_least_squares(rows, parameters)
    else:
        sources = instrument_sources(configuration, model, motions, prepared.cutoffs)
        estimate = idim_iv(
            rows,
            sources.sources,
            sources.starts,
            tolerance=configuration.identification.tolerance,
            max_iterations=configuration.identification.max_iterations,
            progress=part_of(watch.progress, 0.5, 0.85),
        )
        linear, weighted = estimate.linear, estimate.least_squares
        rows = with_instruments(rows, estimate.instruments.matrices)
    watch.stage("validation", 0.85)
    validation = validate(prepared, rows, linear, estimate)
    watch.stage("refinement", 0.95)
    refined = refined_idim_iv(rows, validation.models, parameters)
    return Identified(
        prepared, estimator, rows, linear, weighted, estimate, sources, validation, refined
    )


def consistent_parameters(
    prepared: PreparedRegression,
    values: FloatArray,
    covariance: FloatArray,
    rows: Sequence[JointRows],
    sigma: FloatArray,
    shared: Collection[str] = (),
) -> tuple[PhysicalParameters | None, str]:
    """Return the nearest physical parameters and nothing, or None and why there are none.

    `values`, `covariance` (b,), (b, b): the refined estimate; `rows`, `sigma`: on which the torque
    is judged, and the residual's standard deviation of each joint; `shared`: friction parameters
    that effects share.
    """
    model, unit = prepared.model, prepared.configuration.signals.effort_unit
    if unit != "N m":
        return None, (
            f"efforts are in {unit}: whether a body is possible is known in kg m² only; give "
            "torque constant times gear ratio as signals.effort_scale, and effort_unit N m"
        )
    if prepared.configuration.identification.exclude:
        return None, (
            "identification.exclude takes base parameters out of the model: the links that are "
            "left are no bodies"
        )
    if not model.robot.has_inertials:
        return None, (
            "the URDF gives no inertia: nothing says how the sums that a recording shows are split "
            "into links; write rough masses and inertias into it"
        )
    try:
        judge = Judge(rows, len(values), sigma)
        return nearest_physical(model.robot, model.base, values, covariance, judge, shared), ""
    except ImportError:
        return None, TO_INSTALL
    except DataError as error:
        return None, str(error)


def assemble_result(
    identified: Identified, physical: tuple[PhysicalParameters | None, str] = (None, "")
) -> IdentificationResult:
    """Gather all that a user is shown of an identification in its result."""
    prepared, validation = identified.prepared, identified.validation
    rows, linear = identified.rows, identified.linear
    estimate, sources = identified.iteration, identified.sources
    configuration, base = prepared.configuration, prepared.model.base
    count = len(base.columns)
    total = sum(len(joint) for joint in rows)
    alpha = configuration.identification.significance
    essential, p_value = essential_parameters(*identified.refined, total, alpha=alpha)
    covariance = AutocorrelatedCovariance(rows, linear.sigma, validation.models, count)
    parameters = _parameters(identified, covariance, essential)
    noise = torque_noise(prepared.motions).tolist()
    tested = validation.tests[1:], validation.residuals, validation.specification, noise
    verdicts = tuple(map(judge_joint, *tested))
    overall = judge_all(verdicts, validation.tests[0])
    failures = () if estimate is None else estimate.failures
    if failures:
        # The loop could not be simulated with the estimates: a wrong model does that.
        sentence = f"{overall.sentence} Tried first, and failed: {failures[0]}."
        overall = replace(overall, sentence=sentence)
    note = "" if estimate is None else estimate.instruments.note
    outcomes = [test.accepted for test in validation.tests]
    orders = tuple(model.order for model in validation.models)
    autocorrelated = any(residual.white is False for residual in validation.residuals)
    parts = list(zip(prepared.session.parts, prepared.motions, strict=True))
    series = tuple(
        results.JointSeries(
            joint.name,
            np.concatenate([part.start + motion.time[motion.kept[:, k]] for part, motion in parts]),
            joint.torque,
            joint.torque - residual,
        )
        for k, (joint, residual) in enumerate(zip(rows, linear.residuals, strict=True))
    )
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
        instruments=results.InstrumentReport(
            accepted=False if False in outcomes else None if None in outcomes else True,
            alpha=alpha,
            source="none: least squares" if estimate is None else estimate.source.name,
            failures=failures,
            notes=tuple(text for text in (note, validation.note) if text),
            tests=validation.tests,
        ),
        specification=results.JointTests(
            alpha=alpha, tests=tuple(chain.from_iterable(validation.specification))
        ),
        exogeneity=results.JointTests(alpha=alpha, tests=validation.exogeneity),
        residuals=tuple(
            results.JointResidual(
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
        fit=results.Fit(
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
        processing=results.ProcessingSummary(
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
        fitted_gains=tuple(
            results.FittedGain(
                joint,
                term,
                float(fit.gains[row, column]),
                float(fit.std[row, column]),
                float(fit.r_squared[row]),
            )
            for fit in (() if sources is None else sources.fits)
            for row, joint in enumerate(configuration.robot.joints)
            for column, term in enumerate(fit.terms)
            if fit.included[row, column]
        ),
        refined=refined_result(*identified.refined, orders, parameters) if autocorrelated else None,
        series=series,
        doubts=prepared.warnings,
        physical=physical[0],
        why_no_physical=physical[1],
        kinematics=kinematics_digest(prepared.model.robot),
    )


def _parameters(
    identified: Identified, covariance: AutocorrelatedCovariance, essential: IntArray
) -> tuple[results.ParameterEstimate, ...]:
    """Every base parameter with its standard deviations, alone and among the essential ones."""
    base, given = identified.prepared.model.base, identified.prepared.given
    rows, weighted, linear = identified.rows, identified.weighted, identified.linear
    std = np.sqrt(np.diag(covariance.matrix))
    white_std = np.sqrt(np.diag(white_covariance(rows, linear.sigma, len(linear.values))))
    ls_std = std
    if identified.iteration is not None:
        residuals = zip(rows, weighted.residuals, strict=True)
        models = [fit_autoregression(residual, joint.segments) for joint, residual in residuals]
        observed = [joint.with_instruments(None) for joint in rows]
        of_ls = AutocorrelatedCovariance(observed, weighted.sigma, models, len(weighted.values))
        ls_std = np.sqrt(np.diag(of_ls.matrix))
    ordinary = solve_least_squares(rows, len(base.columns), weighted=False)
    places = {int(column): place for place, column in enumerate(essential)}
    # Estimated again with the essential parameters only, same weights.
    restricted = [joint.reduced.keep(essential) for joint in rows]
    reduced = solve_instrumental_variables(restricted, len(places), linear.sigma).values
    reduced_std = np.sqrt(np.diag(covariance.restricted(essential)))
    return tuple(
        results.ParameterEstimate(
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


def refined_result(
    values: FloatArray,
    covariance: FloatArray,
    orders: tuple[int, ...],
    parameters: Sequence[results.ParameterEstimate],
) -> results.Refined:
    """Refined estimates, and which of the unrefined ones whitening moves beyond noise."""
    estimates, moved = [], []
    std = np.sqrt(np.diag(covariance))
    for parameter, value, deviation in zip(parameters, values.tolist(), std.tolist(), strict=True):
        same = {name: getattr(parameter, name) for name in _OF_PARAMETER}
        estimates.append(results.RefinedEstimate(**same, value=value, std=deviation))
        # Whitening moves no estimate further than noise does where the model is right.
        apart = in_deviations(parameter.value, parameter.std, value, deviation)
        if parameter.essential and abs(apart) > _FAR_APART:
            moved.append(parameter.name)
    return results.Refined(orders, tuple(estimates), tuple(moved))


def _convergence(
    estimate: IdimIvEstimate | None, names: tuple[str, ...], configuration: Configuration
) -> str:
    if estimate is None:
        return "least squares needs no iteration"
    if not estimate.steps:
        return "the instruments do not depend on the parameters: one step"
    change, parameter = estimate.steps[-1]
    moved = f"{names[parameter]} moved last, by {100.0 * change:.2g} %"
    tolerance = f"{100.0 * configuration.identification.tolerance:g} %"
    if estimate.converged:
        return f"{moved} (tolerance {tolerance})"
    return f"not converged: {moved}, more than {tolerance}"


def _relative_error(rows: Sequence[JointRows], linear: LinearEstimate) -> float:
    error = sum(float(residual @ residual) for residual in linear.residuals)
    torque = sum(float(joint.torque @ joint.torque) for joint in rows)
    return 100.0 * float(np.sqrt(error / torque)) if torque > 0.0 else float("nan")


def _bags(prepared: PreparedRegression) -> tuple[results.BagSummary, ...]:
    session = prepared.session
    parts = zip(session.recordings, session.parts, prepared.motions, strict=True)
    return tuple(
        results.BagSummary(
            path=str(recording.path),
            rate=recording.rate,
            duration=recording.duration,
            session_start=part.start,
            samples=recording.samples,
            signals=tuple(of.origin for name in _SIGNALS if (of := getattr(recording, name))),
            clocks=recording.clocks,
            notes=recording.notes,
            dropped=motion.dropped,
            frozen=recording.frozen,
        )
        for recording, part, motion in parts
    )


def software_versions() -> dict[str, str]:
    """Versions of the project and of the packages that its numbers depend on."""
    return {package: metadata.version(package) for package in _REPORTED}
