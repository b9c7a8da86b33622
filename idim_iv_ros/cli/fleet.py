"""`idim-iv fleet identify` and `idim-iv fleet diagnose`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.text import Text
from typer import Argument, Option

from idim_iv_ros.cli import output as shared
from idim_iv_ros.cli.output import LONGEST, Output, next_command, print_table, report_warnings
from idim_iv_ros.errors import DataError
from idim_iv_ros.files import FLEET, FLEET_PAGE

if TYPE_CHECKING:
    from idim_iv_ros.fleet.commands import Fleet, FleetRun

fleet = typer.Typer(
    no_args_is_help=True,
    help="Many robots, many bags: which robots differ, which have changed, what is known of their "
    'type. Needs Dask: pip install "idim-iv-ros\\[fleet]".',
)
_SHOWN = 5  # bags that are not used

_HELP = {
    "identify": """\
Identify every bag; compare the robots of each type, and each robot over time.

Writes fleet.json, fleet.parquet and fleet.html. What was done before is kept, so that the same
command goes on after an interruption, or with new bags.

Example: idim-iv fleet identify manifest.csv --config arm.yaml --out fleet
""",
    "diagnose": """\
Identify every bag, then say why robots differ or have changed, and what their type lacks.

The full diagnosis is made of robots that differ, changed or scatter, and of a few ordinary
ones for their type; each has a report of its own in robots/ROBOT/.

Example: idim-iv fleet diagnose s3://robots/2026 --config robots --out fleet
""",
}


@fleet.command("diagnose", help=_HELP["diagnose"])
@fleet.command("identify", help=_HELP["identify"])
def fleet_command(
    context: typer.Context,
    source: Annotated[
        str,
        Argument(
            help="A manifest (.csv or .parquet with the columns uri, robot, and also type and "
            "time), or a folder or URL (s3://, gs://, …) that is searched: ROBOT/BAG or "
            "TYPE/ROBOT/BAG."
        ),
    ],
    config: Annotated[
        Path,
        Option(
            metavar="FILE.yaml|FOLDER",
            help="One configuration for all robots, or a folder with ROBOT.yaml or TYPE.yaml.",
        ),
    ],
    out: shared.Out,
    scheduler: str | None = Option(
        None,
        metavar="ADDRESS",
        help="Of a running Dask scheduler, as in tcp://host:8786; left out, workers "
        "are started on this machine.",
    ),
    workers: int | None = Option(
        None, help="How many on this machine; left out, one for each core."
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
) -> None:
    """Run `fleet identify` or `fleet diagnose`, by the name of the command."""
    from idim_iv_ros.fleet.commands import FleetRun, diagnose_fleet, identify_fleet
    from idim_iv_ros.fleet.result import TABLE, write_table
    from idim_iv_ros.report.write import require_writable, write_report

    output = Output(quiet=quiet)
    run = FleetRun(source, config, out, scheduler, workers)
    name = str(context.info_name)
    with output.progress() as progress:
        with require_writable(out, (TABLE, FLEET, FLEET_PAGE), force=force):
            answer = {"identify": identify_fleet, "diagnose": diagnose_fleet}[name](run, progress)
            write_table(answer.bags, out / TABLE)
        with report_warnings():
            pages = _write_robots(answer, run, force)
            reports = {robot: page.relative_to(out).as_posix() for robot, page in pages.items()}
            _, page = write_report(
                answer.result, out, reports=reports, force=force, config=config, bags=[source]
            )
    _print_fleet(output.console, answer, pages)
    output.line(f"Numbers: {out / FLEET}; a row for each bag and parameter: {out / TABLE}")
    if page is not None:
        output.line(f"Report: {page}")
    if not any(bag.used for bag in answer.result.bags):
        output.line(f"Next: {_next_command(name, run, answer)}")
        first = answer.result.bags[0]
        words = f"none of {len(answer.bags):,} bags can be used"
        raise DataError(f"{words}: {first.uri}: {first.why_not}")


def _next_command(name: str, run: FleetRun, answer: Fleet) -> str:
    from idim_iv_ros.fleet.source import is_local, local_path, path_of

    config = Path(run.config)
    for bag in answer.bags:
        if bag.status != "missing" and is_local(bag.uri):
            return next_command("check", [local_path(bag.uri)], path_of(bag, config))
    return next_command("fleet", [name, run.source], config, "--out", str(run.out))


def _write_robots(answer: Fleet, run: FleetRun, force: bool) -> dict[str, Path]:
    from idim_iv_ros.report.write import write_report

    pages = {}
    bags = {screened.robot: screened.bags for screened in answer.result.screen}
    for robot, gap in answer.diagnoses.items():
        folder = Path(run.out) / "robots" / robot
        page: Path | None = folder / "report.html"
        if not isinstance(gap, str) and gap.series:
            _, page = write_report(gap, folder, force=force, config=run.config, bags=bags[robot])
        if page is not None and page.is_file():
            pages[robot] = page
    return pages


def _print_fleet(console: Console, answer: Fleet, pages: dict[str, Path]) -> None:
    from idim_iv_ros.report.fleet import headline

    result = answer.result
    left_out = [bag for bag in result.bags if not bag.used]
    plural = "" if len(result.robots) == 1 else "s"
    used = f"{len(result.bags) - len(left_out):,} of {len(result.bags):,} bags used"
    console.print(Text(f"{used}, {len(result.robots):,} robot{plural}"), soft_wrap=True)
    rows = []
    for robot in result.robots:
        why, *more = robot.reasons or ("",)
        if more:
            why = f"{why}; and {len(more)} more"
        if robot.attention != "none":
            rows.append((robot.robot, robot.type, why, str(robot.bags)))
    if rows:
        title, columns = "Robots that need attention, most urgent first", ("robot", "type", "why")
        rest = "the report has them"
        print_table(console, title, (*columns, ">bags"), rows, most=LONGEST, rest=rest)
    lines = [] if rows else [headline(result)]
    for kind in result.types:
        lines += [*kind.sentences, *kind.notes]
    lines += [f"Not used: {bag.uri}: {bag.why_not}" for bag in left_out[:_SHOWN]]
    if len(left_out) > _SHOWN:
        lines.append(f"… and {len(left_out) - _SHOWN} more bags are not used; the report has them")
    for name, gap in answer.diagnoses.items():
        if isinstance(gap, str):
            lines.append(f"Not diagnosed: {name}: {gap}")
        elif name in pages:
            lines.append(f"{name}: {pages[name]}")
    for line in lines:
        console.print(Text(line), soft_wrap=True)
