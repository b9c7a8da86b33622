"""`idim-iv fleet identify` and `idim-iv fleet diagnose`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from idim_iv_ros.cli.arguments import Force, Out, Quiet, Verbose

if TYPE_CHECKING:
    from idim_iv_ros.cli.output import Output
    from idim_iv_ros.fleet.diagnose import Fleet
    from idim_iv_ros.fleet.run import FleetRun

fleet = typer.Typer(
    no_args_is_help=True,
    help="Many robots, many bags: which robots differ, which have changed, what is known of their "
    'type. Needs Dask: pip install "idim-iv-ros\\[fleet]".',
)

Source = Annotated[
    str,
    typer.Argument(
        help="A manifest (.csv or .parquet with the columns uri, robot, and also type, time, "
        "labels), a folder, or a URL (s3://, gs://, …) that is searched: ROBOT/BAG or "
        "TYPE/ROBOT/BAG."
    ),
]
FleetConfig = Annotated[
    Path,
    typer.Option(
        "--config",
        metavar="FILE.yaml|FOLDER",
        help="One configuration for all robots, or a folder with ROBOT.yaml or TYPE.yaml.",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Of a running Dask scheduler, as in tcp://host:8786; left out, workers are started "
        "on this machine.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(help="How many on this machine; left out, one for each core."),
]


_IDENTIFY = """\
Identify every bag; compare the robots of each type, and each robot over time.

Writes fleet.json, fleet.parquet and fleet.html. What was done before is kept, so that the same
command goes on after an interruption, or with new bags.

Example: idim-iv fleet identify manifest.csv --config arm.yaml --out fleet
"""
_DIAGNOSE = """\
Identify every bag, then say why robots differ or have changed, and what their type lacks.

The full diagnosis is made of robots that differ, changed or scatter, and of a few ordinary
ones for their type; each has a report of its own in robots/ROBOT/.

Example: idim-iv fleet diagnose s3://robots/2026 --config robots --out fleet
"""


def _add(name: str, about: str) -> None:
    """Make a command of a public function; both have the same arguments."""

    @fleet.command(name, help=about)
    def command(
        source: Source,
        config: FleetConfig,
        out: Out,
        scheduler: Scheduler = None,
        workers: Workers = None,
        force: Force = False,
        quiet: Quiet = False,
        verbose: Verbose = False,
    ) -> None:
        from idim_iv_ros.cli.output import Output
        from idim_iv_ros.fleet.run import FleetRun

        run = FleetRun(source, config, out, scheduler, workers)
        _run(name, run, Output(quiet=quiet, verbose=verbose), force)


_add("identify", _IDENTIFY)
_add("diagnose", _DIAGNOSE)


def _run(name: str, run: FleetRun, output: Output, force: bool) -> None:
    from idim_iv_ros.cli.output import report_warnings
    from idim_iv_ros.files import FLEET, FLEET_PAGE
    from idim_iv_ros.fleet.diagnose import diagnose_fleet, identify_fleet
    from idim_iv_ros.fleet.table import FILE, write_table
    from idim_iv_ros.report import require_writable
    from idim_iv_ros.report.write import write_fleet_report

    function = {"identify": identify_fleet, "diagnose": diagnose_fleet}[name]
    out = Path(run.out)
    with output.progress() as progress:
        with require_writable(out, (FILE, FLEET, FLEET_PAGE), force=force):
            found = function(run, progress)
            write_table(found.bags, out / FILE)
        with report_warnings():
            pages = _write_robots(found, run, force)
            reports = {robot: page.relative_to(out).as_posix() for robot, page in pages.items()}
            _, page = write_fleet_report(found.result, out, reports=reports, force=force)
    _print(output, found, pages)
    output.line(f"Numbers: {out / FLEET}; a row for each bag and parameter: {out / FILE}")
    if page is not None:
        output.line(f"Report: {page}")
    _require_used(name, run, found, output)


def _require_used(name: str, run: FleetRun, found: Fleet, output: Output) -> None:
    """Refuse an answer that is of no bag, with the command that says more."""
    from idim_iv_ros.cli.output import next_command
    from idim_iv_ros.errors import DataError
    from idim_iv_ros.fleet.remote import is_local, local_path
    from idim_iv_ros.fleet.robots import path_of

    if any(bag.used for bag in found.result.bags):
        return
    here = [bag for bag in found.bags if bag.status != "missing" and is_local(bag.uri)]
    if here:
        config = path_of(here[0], Path(run.config))
        command = next_command("check", [local_path(here[0].uri)], config)
    else:
        again = [name, run.source]
        command = next_command("fleet", again, str(run.config), "--out", str(run.out))
    output.line(f"Next: {command}")
    first = found.result.bags[0]
    raise DataError(f"none of {len(found.bags):,} bags can be used: {first.uri}: {first.why_not}")


def _write_robots(found: Fleet, run: FleetRun, force: bool) -> dict[str, Path]:
    """Reports of the robots that were diagnosed, by robot."""
    from idim_iv_ros.report import write_gap_report

    pages = {}
    for each in found.diagnoses:
        folder = Path(run.out) / "robots" / each.screened.robot
        page: Path | None = folder / "report.html"
        if each.gap is not None and each.gap.series:
            _, page = write_gap_report(each.gap, folder, force=force, config=run.config)
        if page is not None and page.is_file():
            pages[each.screened.robot] = page
    return pages


def _print(output: Output, found: Fleet, pages: dict[str, Path]) -> None:
    from idim_iv_ros.cli.table import print_table
    from idim_iv_ros.report.fleet import headline

    used = [bag for bag in found.result.bags if bag.used]
    left_out = [bag for bag in found.result.bags if not bag.used]
    output.line(
        f"{len(used):,} of {len(found.bags):,} bags used, {_robots(len(found.result.robots))}"
    )
    noticed = [robot for robot in found.result.robots if robot.attention != "none"]
    if noticed:
        print_table(
            output.console,
            "Robots that need attention, most urgent first",
            ["robot", "type", "why", ">bags"],
            [
                [robot.robot, robot.type, _why(robot.reasons, output.verbose), str(robot.bags)]
                for robot in noticed
            ],
            whole=output.verbose,
            rest="--verbose prints all, and fleet.json has them",
        )
    else:
        output.line(headline(found.result))
    for kind in found.result.types:
        for sentence in (*kind.sentences, *kind.notes):
            output.line(sentence)
    for bag in left_out if output.verbose else left_out[:5]:
        output.line(f"Not used: {bag.uri}: {bag.why_not}")
    if len(left_out) > 5 and not output.verbose:
        output.line(f"… and {len(left_out) - 5} more bags are not used; --verbose prints all")
    for each in found.diagnoses:
        if each.gap is None:
            output.line(f"Not diagnosed: {each.screened.robot}: {each.reason}")
        elif each.screened.robot in pages:
            output.line(f"{each.screened.robot}: {pages[each.screened.robot]}")


def _robots(count: int) -> str:
    return f"{count:,} robot{'' if count == 1 else 's'}"


def _why(reasons: Sequence[str], verbose: bool) -> str:
    """The strongest reason, or all of them."""
    if verbose or len(reasons) < 2:
        return "; ".join(reasons)
    return f"{reasons[0]}; and {len(reasons) - 1} more"
