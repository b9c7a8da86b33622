"""`idim-iv identify`."""

import shlex
from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from idim_iv_ros.cli.arguments import Bags, Config, Out, progress_bar
from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.identification import identify
from idim_iv_ros.report import require_writable, write_report
from idim_iv_ros.result import IMPOSSIBLE, NOT_SIGNIFICANT, IdentificationResult


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
    with require_writable(out), progress_bar() as progress:
        result = identify(bags, configuration, estimator=estimator.value, progress=progress)
        _, html = write_report(result, out)
    console = Console()
    console.print(parameter_table(result))
    print_remarks(console, result)
    print_verdict(console, result)
    print_next(console, result, bags, config)
    console.print(f"Report: {html}", soft_wrap=True, highlight=False)


def parameter_table(result: IdentificationResult, truth: dict[str, float] | None = None) -> Table:
    """Essential parameters with their standard deviations, beside the true values if known."""
    title = f"{result.robot}: essential parameters, {result.estimator}"
    table = Table(title=title, title_justify="left")
    table.add_column("parameter")
    for heading in ("value", "σ", "%σ", *(["truth", "off by"] if truth else [])):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    remarked = any(parameter.essential_remark for parameter in result.parameters)
    if remarked:
        table.add_column("remark")
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
        cells.append(parameter.unit)
        table.add_row(*cells, *([parameter.essential_remark] if remarked else []))
    return table


def print_remarks(console: Console, result: IdentificationResult) -> None:
    """What the remarks of the table mean, where there are any."""
    found = {parameter.essential_remark for parameter in result.parameters}
    if IMPOSSIBLE in found:
        console.print(
            f"{IMPOSSIBLE}: negative beyond its 95 % interval, and nothing that it groups may be: "
            "the model lacks an effect that it takes up, or the motion does not excite it.",
            highlight=False,
        )
    if NOT_SIGNIFICANT in found:
        console.print(
            f"{NOT_SIGNIFICANT}: its 95 % interval holds zero; it is essential together with "
            "others, not alone.",
            highlight=False,
        )


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
    errors = fit.joint_relative_error_percent
    if errors:
        listed = ", ".join(
            f"{joint} {'–' if error is None else f'{error:.3g} %'}"
            for joint, error in errors.items()
        )
        console.print(f"Relative error of the torque by joint: {escape(listed)}", highlight=False)
    console.print(f"Instruments: {result.instruments.source}", highlight=False)
    console.print(f"Verdict: {result.verdict.verdict}. {result.verdict.sentence}", highlight=False)
    for bag in result.bags:
        for each in bag.frozen:
            text = f"[yellow]Warning:[/] {escape(f'{Path(bag.path).name}: {each.sentence}')}"
            console.print(text, highlight=False)


def print_next(
    console: Console, result: IdentificationResult, bags: Sequence[Path], config: Path
) -> None:
    """Name the command that looks for the cause of a model error, with its arguments."""
    if result.verdict.verdict == "model error here":
        recordings = " ".join(shlex.quote(str(bag)) for bag in bags)
        console.print(
            escape(
                f"Next: idim-iv diagnose {recordings} --config {shlex.quote(str(config))} --out why"
            ),
            soft_wrap=True,
            highlight=False,
        )
