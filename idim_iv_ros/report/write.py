"""The files of a result: the numbers first and whole, then the page that shows them."""

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from idim_iv_ros.diagnosis.result.document import GapResult
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
from idim_iv_ros.report.section import CONFIGURATION, Files
from idim_iv_ros.report.servo import servo_html
from idim_iv_ros.servo.result import ServoResult
from idim_iv_ros.simulators.replay_result import ReplayResult

Written = IdentificationResult | GapResult | ReplayResult | ServoResult | FleetResult

# File of numbers, file of the page, and what draws it.
_FILES: dict[type[Any], tuple[str, str, Callable[..., str]]] = {
    IdentificationResult: (RESULT, REPORT, report_html),
    GapResult: (GAP, REPORT, gap_report_html),
    ReplayResult: (REPLAY, REPORT, replay_html),
    ServoResult: (SERVO, REPORT, servo_html),
    FleetResult: (FLEET, FLEET_PAGE, fleet_html),
}


def write_report(
    result: Written,
    out: FilePath,
    *,
    force: bool = False,
    config: FilePath = CONFIGURATION,
    bags: Sequence[FilePath] = (),
    reports: Mapping[str, str] | None = None,
) -> tuple[Path, Path | None]:
    """Write the numbers of a result, then its page: result.json and report.html, for example.

    Files are written under other names and renamed when complete, so that `out` never holds a
    partial file. What cannot be drawn or written of the page is a `ReportWarning`.

    - `out`: folder; created if it does not exist
    - `force`: replace files there that this program did not write
    - `config`, `bags`: the robot's configuration file and the recordings as commands on the page
      name them; of a fleet its source
    - `reports`: of a fleet, address of each robot's report, relative to `out`, by the robot's name

    Returns the paths of numbers and page; None where there is no page, and none of an earlier
    result. Raises UsageError: the folder cannot be written, or holds another result or a file not
    by this program.
    """
    name, page_name, html = _FILES[type(result)]
    draw = partial(html, result, files=Files(str(config), str(out), tuple(map(str, bags))))
    if isinstance(result, FleetResult):
        draw = partial(draw, reports=reports)
    numbers, page = Path(out) / name, Path(out) / page_name
    with require_writable(Path(out), (name, page_name), force=force):
        try:
            write_together({numbers: result.to_json()})
        except OSError as error:
            raise _refusal(Path(out), error) from error
    try:
        # The page of an earlier result would pass for that of this one.
        page.unlink(missing_ok=True)
        write_together({page: draw()})
    except Exception as error:
        if os.environ.get("IDIM_IV_TRACEBACK"):
            raise
        warnings.warn(
            f"{page}: the report cannot be drawn or written ({one_line(error)}); all numbers are "
            f"in {numbers}",
            ReportWarning,
            stacklevel=2,
        )
        return numbers, None
    return numbers, page


# Public names: a diagnosis and a replay have had functions of their own.
write_gap_report = write_replay_report = write_report


@contextmanager
def require_writable(
    out: Path, names: Sequence[str] = (RESULT, REPORT), *, force: bool = False
) -> Iterator[None]:
    """Check, before long work, that its results can be written afterwards.

    The folder is created if it does not exist, and removed again (with the created parents) if the
    work inside the ``with`` fails and left nothing in it.

    `names` are those of the files that will be written into `out`; `force` replaces any files.

    Raises UsageError: the folder cannot be written, and why; or it holds the report of another
    command, or a file that this program did not write.
    """
    with ExitStack() as undone:
        try:
            # The result beside report.html says which command wrote both.
            for kind, (name, page, _) in _FILES.items():
                another = page == REPORT and REPORT in names and name not in names
                if not force and another and (out / REPORT).exists() and (out / name).exists():
                    raise UsageError(
                        f"{out}: holds {name} and {REPORT} of `idim-iv {kind.written_by}`, and "
                        f"{REPORT} would be replaced; give another --out, or --force"
                    )
            require_replaceable([out / name for name in names], force=force)
            undone.enter_context(made_folder(out))
            probe_place(out / names[0])
        except OSError as error:
            raise _refusal(out, error) from error
        yield


def _refusal(out: Path, error: OSError) -> UsageError:
    taken = isinstance(error, (NotADirectoryError, FileExistsError))
    reason = "a file is in its place" if taken else error.strerror or str(error)
    return UsageError(f"{out}: cannot write the report there: {reason}; give another --out")
