"""From recordings to causes: the whole of `idim-iv diagnose` without its files."""

import os
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from idim_iv_ros.compilation import one_thread
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.diagnosis.against.contrast import contrasted
from idim_iv_ros.diagnosis.answer.explained import Explained, explained
from idim_iv_ros.diagnosis.assembly import concluded
from idim_iv_ros.diagnosis.comparison.candidate import Catalogue
from idim_iv_ros.diagnosis.comparison.ledger import torque_ledger
from idim_iv_ros.diagnosis.comparison.select import select
from idim_iv_ros.diagnosis.nominal import read_nominal_model, with_nominal
from idim_iv_ros.diagnosis.refit.refit import Refit, refitted
from idim_iv_ros.diagnosis.result import ContrastResult, GapResult
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import FilePath, FilePaths
from idim_iv_ros.identification.prepare import read_configured
from idim_iv_ros.memory import return_freed_memory
from idim_iv_ros.progress import Progress, Stopwatch


def diagnose(
    bags: FilePaths,
    configuration: Configuration,
    *,
    without: Sequence[str] = (),
    against: FilePaths = (),
    nominal: FilePath | None = None,
    progress: Progress | None = None,
) -> GapResult:
    """Say where simulator and robot differ, which effect causes it, and how far the gap shrinks.

    Parameters
    ----------
    bags
        One recording or several of one robot, used together: text or paths.
    configuration
        See `load_configuration`; the URDF, its `<dynamics>` and `simulator` are the nominal model.
    without
        Effects that are left out of the catalogue.
    against
        Recordings of the same robot, or of a simulator of it, that may differ: what changed from
        `bags` to them is `GapResult.contrast`. Everything else is of `bags` alone.
    nominal
        A result.json or gap.json whose base parameters take the place of the URDF's.
    progress
        Called with a stage in words and the share that is done, 0 to 1.

    Raises
    ------
    UsageError, DataError
        As `identify`.
    """
    excluded = tuple(without)
    given = [bags] if isinstance(bags, (str, os.PathLike)) else list(bags)
    second = [against] if isinstance(against, (str, os.PathLike)) else list(against)
    _require_two_sets(given, second)
    identified = None if nominal is None else read_nominal_model(nominal, configuration)
    with one_thread(), Stopwatch(progress) as watch:
        watch.stage("reading", 0.0)
        recordings = read_configured(given, configuration, progress)
        others = read_configured(second, configuration, progress) if second else ()
        return_freed_memory()
        watch.stage("refit", 0.1)
        with_given = None if identified is None else partial(with_nominal, identified=identified)
        refit = refitted(recordings, configuration, excluded, with_given)
        return_freed_memory()
        watch.stage("attribution", 0.2)
        explanation = compared(refit, excluded)
        return_freed_memory()
        result = concluded(refit, explanation, configuration, excluded, watch)
        if identified is not None:
            result = replace(result, nominal=identified.nominal)
        if second:
            watch.stage("contrast", 0.97)
            # Of the configuration with gravity, where it was missing and found.
            robot = refit.data.prepared.configuration.robot
            same = configuration.model_copy(update={"robot": robot})
            contrast = contrasted(recordings, others, same, excluded)
            result = _with_contrast(result, contrast)
    result.timing.update(watch.timing)
    return result


def _require_two_sets(reference: Sequence[FilePath], against: Sequence[FilePath]) -> None:
    """Refuse a recording that is in both sets.

    Raises
    ------
    UsageError
        It names the recording.
    """
    first_set = {os.path.realpath(recording) for recording in reference}
    for recording in against:
        if os.path.realpath(recording) in first_set:
            raise UsageError(
                f"--against {recording}: it is among the reference recordings, too; "
                "a set cannot differ from itself"
            )


def _with_contrast(result: GapResult, contrast: ContrastResult) -> GapResult:
    """Return the diagnosis of the reference set with what changed, first in its summary."""
    listed = ", ".join(result.bags)
    summary = f"{contrast.sentence} The reference ({listed}) by itself: {result.summary}"
    return replace(result, contrast=contrast, summary=summary)


def compared(refit: Refit, without: tuple[str, ...]) -> Explained:
    """Search for what explains the gap, and judge it."""
    data, regression = refit.data, refit.regression
    catalogue = Catalogue(data, regression, without, refit.hidden)
    selection = select(catalogue, torque_ledger(data, regression))
    return explained(data, regression, selection)
