"""The files of a result: the numbers first and whole, then the page that shows them."""

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.errors import ReportWarning, UsageError, one_line
from idim_iv_ros.files import (
    FLEET,
    FLEET_PAGE,
    GAP,
    REPLAY,
    REPORT,
    RESULT,
    SERVO,
    FilePath,
    made_folder,
    probe_place,
    require_replaceable,
    write_together,
)
from idim_iv_ros.fleet.result import FleetResult
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.fleet import fleet_html
from idim_iv_ros.report.page import gap_report_html, report_html
from idim_iv_ros.report.replay import replay_html
from idim_iv_ros.report.section import CONFIGURATION
from idim_iv_ros.report.servo import servo_html
from idim_iv_ros.servo.result import ServoResult
from idim_iv_ros.simulators.replay_result import ReplayResult

_WRITTEN_BY = {RESULT: "identify", GAP: "diagnose", REPLAY: "replay", SERVO: "servo"}


def write_report(
    result: IdentificationResult,
    out: FilePath,
    *,
    force: bool = False,
    config: FilePath = CONFIGURATION,
) -> tuple[Path, Path | None]:
    """Write result.json, then report.html.

    Each is written beside its place and moved there when it is complete, so that no half-written
    file is ever found under `out`. No picture costs a result: what cannot be drawn or written of
    the page is a `ReportWarning`.

    Parameters
    ----------
    result : IdentificationResult
        What `identify` found.
    out : str or Path
        Folder; created if it does not exist.
    force : bool
        Replace files there that this program did not write.
    config : str or Path
        The robot's configuration file as the page names it in commands and instructions.

    Returns
    -------
    Path, Path or None
        result.json and report.html; None where there is no page, and none of an earlier result.

    Raises
    ------
    UsageError
        The folder cannot be written, or holds a diagnosis or a file of somebody else.
    """
    draw = partial(report_html, result, str(config))
    return _write(Path(out), RESULT, result.to_json(), draw, force)


def write_gap_report(
    result: GapResult, out: FilePath, *, force: bool = False, config: FilePath = CONFIGURATION
) -> tuple[Path, Path | None]:
    """Write gap.json, then report.html; otherwise as `write_report`.

    Parameters
    ----------
    result : GapResult
        What `diagnose` found.
    out : str or Path
        Folder; created if it does not exist.
    force : bool
        Replace files there that this program did not write.
    config : str or Path
        The robot's configuration file as the page names it in commands and instructions.

    Returns
    -------
    Path, Path or None
        gap.json and report.html; None where there is no page, and none of an earlier result.

    Raises
    ------
    UsageError
        The folder cannot be written, or holds an identification or a file of somebody else.
    """
    draw = partial(gap_report_html, result, str(config))
    return _write(Path(out), GAP, result.to_json(), draw, force)


def write_replay_report(
    result: ReplayResult, out: FilePath, *, force: bool = False
) -> tuple[Path, Path | None]:
    """Write replay.json, then report.html; otherwise as `write_report`.

    Returns
    -------
    Path, Path or None
        replay.json and report.html; None where there is no page, and none of an earlier result.

    Raises
    ------
    UsageError
        The folder cannot be written, or holds another result or a file of somebody else.
    """
    return _write(Path(out), REPLAY, result.to_json(), partial(replay_html, result), force)


def write_servo_report(
    result: ServoResult, out: FilePath, *, force: bool = False
) -> tuple[Path, Path | None]:
    """Write servo.json, then report.html; otherwise as `write_report`."""
    return _write(Path(out), SERVO, result.to_json(), partial(servo_html, result), force)


def write_fleet_report(
    result: FleetResult,
    out: FilePath,
    *,
    reports: Mapping[str, str] | None = None,
    force: bool = False,
) -> tuple[Path, Path | None]:
    """Write fleet.json, then fleet.html; otherwise as `write_report`.

    Parameters
    ----------
    result : FleetResult
        What `fleet_result` found.
    out : str or Path
        Folder; created if it does not exist.
    reports : mapping of str to str, optional
        Address of each robot's own report, relative to `out`, by the name of the robot.
    force : bool
        Replace files there that this program did not write.

    Returns
    -------
    Path, Path or None
        fleet.json and fleet.html; None where there is no page, and none of an earlier result.

    Raises
    ------
    UsageError
        The folder cannot be written, or holds a file of somebody else.
    """
    draw = partial(fleet_html, result, reports)
    return _write(Path(out), FLEET, result.to_json(), draw, force, FLEET_PAGE)


@contextmanager
def require_writable(
    out: Path, names: Sequence[str] = (RESULT, REPORT), *, force: bool = False
) -> Iterator[None]:
    """Make sure, before long work, that its results can be written afterwards.

    The folder is created if it does not exist, and removed again (with the parents that were
    created for it) if the work inside the ``with`` fails and left nothing in it.

    Parameters
    ----------
    out : Path
        Folder of the results.
    names : sequence of str
        Of the files that will be written there.
    force : bool
        Let files there be replaced whoever wrote them.

    Raises
    ------
    UsageError
        The folder cannot be written, and why; or it holds the report of another command,
        or a file that this program did not write.
    """
    with ExitStack() as undone:
        try:
            if not force:
                _keep_other_report(out, names)
            require_replaceable([out / name for name in names], force=force)
            undone.enter_context(made_folder(out))
            _probe(out, names)
        except OSError as error:
            raise _refusal(out, error) from error
        yield


def _keep_other_report(out: Path, names: Sequence[str]) -> None:
    """Refuse a folder whose report.html is that of the other command: both have one."""
    for name, command in _WRITTEN_BY.items():
        if name in names or REPORT not in names:
            continue
        if (out / name).exists() and (out / REPORT).exists():
            raise UsageError(
                f"{out}: holds {name} and {REPORT} of `idim-iv {command}`, and {REPORT} would be "
                "replaced; give another --out, or --force"
            )


def _probe(out: Path, names: Sequence[str]) -> None:
    for name in names:
        if (out / name).is_dir():
            raise IsADirectoryError(f"{name} is a folder there")
    probe_place(out / names[0])


def _write(
    out: Path, name: str, text: str, draw: Callable[[], str], force: bool, report: str = REPORT
) -> tuple[Path, Path | None]:
    """Write the numbers, then draw the page and write it."""
    numbers, page = out / name, out / report
    with require_writable(out, (name, report), force=force):
        try:
            write_together({numbers: text})
        except OSError as error:
            raise _refusal(out, error) from error
    try:
        # That of an earlier result would pass for the page of this one.
        page.unlink(missing_ok=True)
        write_together({page: draw()})
    except Exception as error:
        if os.environ.get("IDIM_IV_TRACEBACK"):
            raise
        warnings.warn(
            f"{page}: the report cannot be drawn or written ({one_line(error)}); all numbers are "
            f"in {numbers}",
            ReportWarning,
            stacklevel=3,
        )
        return numbers, None
    return numbers, page


def _refusal(out: Path, error: OSError) -> UsageError:
    if isinstance(error, (NotADirectoryError, FileExistsError)):
        reason = "a file is in its place"
    else:
        reason = error.strerror or str(error)
    return UsageError(f"{out}: cannot write the report there: {reason}; give another --out")
