"""From recordings to validated parameters: the whole of `idim-iv identify` without its files."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.idim_iv import idim_iv, refined_idim_iv
from idim_iv_ros.estimation.least_squares import solve_least_squares
from idim_iv_ros.estimation.observation import observation_rows
from idim_iv_ros.estimation.rows import JointRows, with_instruments
from idim_iv_ros.estimation.sources import instrument_sources
from idim_iv_ros.files import FilePaths
from idim_iv_ros.identification.assembly import Identified, assemble_result
from idim_iv_ros.identification.prepare import (
    PreparedRegression,
    prepare,
    read_configured,
    require_excitation,
)
from idim_iv_ros.identification.result import Estimator, IdentificationResult
from idim_iv_ros.identification.validate import validate
from idim_iv_ros.physical import PhysicalParameters, nearest_physical
from idim_iv_ros.physical.nearest import TO_INSTALL, Judge
from idim_iv_ros.progress import Progress, Stopwatch, part_of
from idim_iv_ros.recording.recording import Recording
from idim_iv_ros.types import FloatArray


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
        refined, rows = everything.refined, everything.rows
        physical = consistent_parameters(
            everything.prepared, refined.values, refined.covariance, rows, everything.linear.sigma
        )
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
    rows = observation_rows(prepared.model, prepared.motions)
    require_excitation(prepared, rows)
    watch.stage("estimation", 0.5)
    parameters = len(prepared.model.base.columns)
    estimate, sources = None, None
    if estimator == "idim-ls":
        linear = weighted = solve_least_squares(rows, parameters)
    else:
        sources = instrument_sources(
            configuration, prepared.model, prepared.motions, prepared.cutoffs
        )
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
    unit = prepared.configuration.signals.effort_unit
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
    if not prepared.model.robot.has_inertials:
        return None, (
            "the URDF gives no inertia: nothing says how the sums that a recording shows are split "
            "into links; write rough masses and inertias into it"
        )
    model = prepared.model
    try:
        judge = Judge(rows, len(values), sigma)
        nearest = nearest_physical(model.robot, model.base, values, covariance, judge, shared)
    except ImportError:
        return None, TO_INSTALL
    except DataError as error:
        return None, str(error)
    return nearest, ""
