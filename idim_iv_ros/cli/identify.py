"""`idim-iv identify`."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from idim_iv_ros.cli.arguments import Bags, Config, Out, progress_bar
from idim_iv_ros.cli.doubts import print_doubts
from idim_iv_ros.cli.report_warnings import report_warnings
from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.identification import identify
from idim_iv_ros.report import require_writable, write_report
from idim_iv_ros.result import IdentificationResult


class EstimatorName(str, Enum):
    """Names of the estimators on the command line."""

    idim_iv = "idim-iv"
    idim_ls = "idim-ls"


def identify_command(
    bags: Bags,
    config: Config,
    out: Out,
    estimator: Annotated[
        EstimatorName, typer.Option(help="Instrumental variables, or least squares.")
    ] = EstimatorName.idim_iv,
) -> None:
    """Identify the dynamic parameters, test them, write result.json and report.html.

    Example: idim-iv identify run1.mcap run2.mcap --config ur5.yaml --out results
    """
    configuration = load_configuration(config)
    with require_writable(out):
        with progress_bar() as progress:
            result = identify(bags, configuration, estimator=estimator.value, progress=progress)
        with report_warnings():
            written, page = write_report(result, out)
    console = Console()
    console.print(parameter_table(result))
    print_verdict(console, result)
    where = f"Report: {page}" if page is not None else f"Numbers: {written}"
    console.print(where, soft_wrap=True, highlight=False, markup=False)


def parameter_table(result: IdentificationResult, truth: dict[str, float] | None = None) -> Table:
    """Essential parameters with their standard deviations, beside the true values if known."""
    title = f"{result.robot}: essential parameters, {result.estimator}"
    table = Table(title=title, title_justify="left")
    table.add_column("parameter")
    for heading in ("value", "σ", "%σ", *(["truth", "off by"] if truth else [])):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    for parameter in result.parameters:
        if not parameter.essential:
            continue
        value, std = parameter.essential_value, parameter.essential_std
        if value is None or std is None:
            continue
        cells = [parameter.name, f"{value:.4g}", f"{std:.2g}", f"{100 * std / abs(value):.2g}"]
        if truth:
            true = truth[parameter.name]
            cells += [f"{true:.4g}", f"{(value - true) / std:+.1f} σ"]
        table.add_row(*cells, parameter.unit)
    return table


def print_verdict(console: Console, result: IdentificationResult) -> None:
    """The verdict, the fit, where the instruments came from, and what was left out."""
    fit = result.fit
    console.print(
        f"{fit.essential_parameters} of {fit.base_parameters} base parameters are essential; "
        f"relative error {fit.relative_error_percent:.3g} % on {fit.samples} rows; "
        f"{result.iterations} iteration{'s' if result.iterations > 1 else ''}, "
        f"{'converged' if result.converged else 'NOT converged'}",
        highlight=False,
    )
    console.print(f"Instruments: {result.instruments.source}", highlight=False)
    console.print(f"Verdict: {result.verdict.verdict}. {result.verdict.sentence}", highlight=False)
    print_doubts(console, result.doubts)
    for bag in result.bags:
        lost = [note.sentence for note in bag.notes if note.limits]
        for sentence in (*lost, *(each.sentence for each in bag.frozen)):
            text = f"[yellow]Warning:[/] {escape(f'{Path(bag.path).name}: {sentence}')}"
            console.print(text, highlight=False)
