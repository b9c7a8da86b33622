"""`idim-iv diagnose`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Protocol

import typer
from rich.console import Console

from idim_iv_ros.cli.arguments import Bags, Config, Out, progress_bar
from idim_iv_ros.cli.diagnosis_tables import print_diagnosis
from idim_iv_ros.cli.report_warnings import report_warnings
from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.formats import GAP, REPORT
from idim_iv_ros.gap.result import GapResult
from idim_iv_ros.report import require_writable, write_gap_report
from idim_iv_ros.stopwatch import Progress


class Diagnose(Protocol):
    """The public function `diagnose`."""

    def __call__(
        self,
        bags: Sequence[Path],
        configuration: Configuration,
        *,
        without: Sequence[str] = (),
        progress: Progress | None = None,
    ) -> GapResult:
        """Diagnose bags."""


def diagnose_command(
    bags: Bags,
    config: Config,
    out: Out,
    without: Annotated[
        list[str] | None,
        typer.Option(
            help="Leave an effect out of the catalogue, to see what is said without it; may be "
            "repeated.",
            metavar="EFFECT",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Say where simulator and robot differ, which effect causes it, and how far the gap shrinks.

    Writes gap.json and report.html.

    Example: idim-iv diagnose run1.mcap run2.mcap --config ur5.yaml --out why
    """
    # Here, so that the help of every command is shown without loading the diagnosis.
    from idim_iv_ros.gap.catalogue import EFFECTS
    from idim_iv_ros.gap.diagnosis import diagnose

    run_diagnosis(bags, config, out, without or (), diagnose=diagnose, effects=EFFECTS)


def run_diagnosis(
    bags: Sequence[Path],
    config: Path,
    out: Path,
    without: Sequence[str],
    *,
    diagnose: Diagnose,
    effects: Sequence[str],
) -> None:
    """Check the request, diagnose, write the files, print the tables.

    Parameters
    ----------
    diagnose
        What makes a `GapResult` of the bags.
    effects
        Names that `without` may hold.

    Raises
    ------
    UsageError
        An effect that the catalogue does not have, or as `load_configuration`.
    """
    for name in without:
        if name not in effects:
            raise UsageError(f"--without {name}: no such effect; there are {', '.join(effects)}")
    configuration = load_configuration(config)
    with require_writable(out, (GAP, REPORT)):
        left_out = tuple(dict.fromkeys(without))
        with progress_bar() as progress:
            result = diagnose(bags, configuration, without=left_out, progress=progress)
        with report_warnings():
            written, page = write_gap_report(result, out)
    console = Console()
    print_diagnosis(console, result)
    where = f"Report: {page}" if page is not None else f"Numbers: {written}"
    console.print(where, soft_wrap=True, highlight=False, markup=False)
