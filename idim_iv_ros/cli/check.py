"""`idim-iv check`."""

import typer
from rich.console import Console
from rich.table import Table

from idim_iv_ros.cli.arguments import Bags, Config, progress_bar
from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.usability import CheckReport, check

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
    plural = "s" if limits > 1 else ""
    console.print(f"Usable, with {limits} limit{plural} named above." if limits else "Usable.")


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
    console.print(
        f"\nWhat the excitation shows (condition number {report.condition_number:.3g}; the "
        "residual of least squares is taken as white, so that these are lower bounds):",
        highlight=False,
    )
    for seen, words in (("well", "well, σ ≤ 10 %"), ("yes", "σ ≤ 30 %")):
        names = [parameter.name for parameter in report.parameters if parameter.seen == seen]
        if names:
            console.print(f"  {words}: {' '.join(names)}", highlight=False)
    poorly = [parameter for parameter in report.parameters if parameter.seen == "poorly"]
    if not poorly:
        return
    table = Table(title="Seen poorly, or small", title_justify="left", box=None)
    table.add_column("parameter")
    table.add_column("visible from (2σ)", justify="right")
    table.add_column("unit")
    for parameter in poorly:
        smallest = "" if parameter.smallest is None else f"{parameter.smallest:.2g}"
        table.add_row(parameter.name, smallest, parameter.unit)
    console.print(table)
