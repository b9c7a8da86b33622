"""`idim-iv check`."""

import typer
from rich.console import Console
from rich.table import Table

from idim_iv_ros.check import CheckReport, check
from idim_iv_ros.cli.arguments import Bags, Config, progress_bar
from idim_iv_ros.configuration import load_configuration

_COLOUR = {"good": "green", "limited": "yellow", "unusable": "red"}


def check_command(bags: Bags, config: Config) -> None:
    """Say whether recordings can support an identification, per joint and per parameter.

    Exit status 1 if they cannot.

    Example: idim-iv check run1.mcap --config ur5.yaml
    """
    configuration = load_configuration(config)
    with progress_bar() as progress:
        report = check(bags, configuration, progress)
    console = Console()
    _print_findings(console, report)
    _print_parameters(console, report)
    if not report.usable:
        console.print("[red]Not usable[/] for an identification.")
        raise typer.Exit(1)
    limits = sum(finding.level == "limited" for finding in report.findings)
    console.print("Usable." if limits == 0 else f"Usable, with {limits} limits named above.")


def _print_findings(console: Console, report: CheckReport) -> None:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column()
    for finding in report.findings:
        level = f"[{_COLOUR[finding.level]}]{finding.level}[/]"
        table.add_row(
            finding.where.replace("[", "\\["), level, finding.sentence.replace("[", "\\[")
        )
    console.print(table)


def _print_parameters(console: Console, report: CheckReport) -> None:
    if report.condition_number is None:
        return
    table = Table(
        title=f"What the excitation shows (condition number {report.condition_number:.3g})",
        title_justify="left",
    )
    table.add_column("parameter")
    table.add_column("seen")
    table.add_column("%σ", justify="right")
    table.add_column("smallest visible", justify="right")
    table.add_column("unit")
    for parameter in report.parameters:
        relative = parameter.relative_percent
        table.add_row(
            parameter.name,
            parameter.seen,
            "" if relative is None else f"{relative:.2g}" if relative < 1000 else "> 1000",
            "" if parameter.smallest is None else f"{parameter.smallest:.2g}",
            parameter.unit,
        )
    console.print(table)
    console.print(
        "%σ and smallest visible value take the least-squares residual as white: lower bounds.",
        highlight=False,
    )
