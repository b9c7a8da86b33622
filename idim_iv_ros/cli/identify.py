"""`idim-iv identify`."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from idim_iv_ros.cli.arguments import (
    AsJson,
    Bags,
    Config,
    Force,
    OutOrJson,
    Picture,
    Quiet,
    Verbose,
)

if TYPE_CHECKING:
    from rich.console import Console

    from idim_iv_ros.cli.output import Output
    from idim_iv_ros.diagnosis.result import GapResult
    from idim_iv_ros.identification.result import IdentificationResult


class EstimatorName(str, Enum):
    """Names of the estimators on the command line."""

    idim_iv = "idim-iv"
    idim_ls = "idim-ls"


def identify_command(
    bags: Bags,
    config: Config,
    out: OutOrJson = None,
    estimator: Annotated[
        EstimatorName, typer.Option(help="Instrumental variables, or least squares.")
    ] = EstimatorName.idim_iv,
    picture: Picture = None,
    force: Force = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
    verbose: Verbose = False,
) -> None:
    """Identify the dynamic parameters, test them, write result.json and report.html.

    Example: idim-iv identify run1.mcap run2.mcap --config ur5.yaml --out results
    """
    from idim_iv_ros.cli.output import Output
    from idim_iv_ros.configuration import load_configuration
    from idim_iv_ros.files import REPORT, RESULT

    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    with output.progress():  # while the libraries are loaded
        from idim_iv_ros.identification.identify import identify
        from idim_iv_ros.report import write_report
        from idim_iv_ros.report.picture import write_picture
    result, numbers, page = output.produce(
        lambda progress: identify(
            bags, configuration, estimator=estimator.value, progress=progress
        ),
        lambda result: write_report(result, out or "", force=force, config=config),
        write_picture,
        out=out,
        names=(RESULT, REPORT),
        picture=picture,
        force=force,
    )
    output.warn_quietly([*result.doubts, *data_warnings(result)])
    print_parameters(output.console, result, whole=verbose)
    print_remarks(output.console, result)
    print_verdict(output.console, result)
    print_next(output.console, result, bags, config)
    print_physical(output, result, numbers, config)
    output.name_files(numbers, page)


def print_physical(
    output: Output, result: IdentificationResult | GapResult, numbers: Path | None, config: Path
) -> None:
    """Name the command that takes the answer into a simulator; else say why it cannot be."""
    from idim_iv_ros.cli.output import next_command

    if result.physical is None:
        if result.why_no_physical:
            output.line(f"No physical parameters for a simulator: {result.why_no_physical}")
        return
    if not result.physical.test.accepted:
        output.line(f"Physical parameters: {result.physical.sentence}")
    if numbers is not None:
        command = next_command("export", [numbers], config, "--out", "simulator")
        output.line(f"Into a simulator: {command}")


def print_parameters(
    console: Console,
    result: IdentificationResult,
    truth: dict[str, float] | None = None,
    *,
    whole: bool = True,
) -> None:
    """Essential parameters with their standard deviations, beside the true values if known.

    The best determined ones come first where not the `whole` table is printed.
    """
    from idim_iv_ros.cli.table import print_table

    columns = ["parameter", ">value", ">σ", ">%σ"]
    if truth:
        columns += [">truth", ">off by"]
    columns.append("unit")
    remarked = any(parameter.essential_remark for parameter in result.parameters)
    if remarked:
        columns.append("remark")
    rows: list[tuple[float, list[str]]] = []
    for parameter in result.parameters:
        value, std = parameter.essential_value, parameter.essential_std
        if not parameter.essential or value is None or std is None:
            continue
        percent = 100.0 * std / abs(value)
        cells = [parameter.name, f"{value:.4g}", f"{std:.2g}", f"{percent:.2g}"]
        if truth:
            true = truth[parameter.name]
            cells += [f"{true:.4g}", f"{(value - true) / std:+.1f} σ"]
        cells.append(parameter.unit)
        if remarked:
            cells.append(parameter.essential_remark)
        rows.append((percent, cells))
    ordered = rows if whole else sorted(rows, key=lambda row: row[0])
    title = f"{result.robot}: essential parameters, {result.estimator}"
    if not whole:
        title += ", best determined first"
    print_table(
        console,
        title,
        columns,
        [cells for _, cells in ordered],
        whole=whole,
        rest="--verbose prints all, and the report has them",
    )


def print_remarks(console: Console, result: IdentificationResult) -> None:
    """What the remarks of the table mean, where there are any."""
    from idim_iv_ros.identification.result import IMPOSSIBLE, NOT_SIGNIFICANT

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
    from rich.markup import escape

    from idim_iv_ros.cli.output import print_doubts

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
    console.print(f"Instruments: {escape(result.instruments.source)}", highlight=False)
    sentence = f"Verdict: {result.verdict.verdict}. {result.verdict.sentence}"
    console.print(escape(sentence), highlight=False)
    print_doubts(console, result.doubts)
    for advice in result.processing.advice:
        console.print(f"[yellow]Advice:[/] {escape(advice)}", highlight=False)
    for warning in data_warnings(result):
        console.print(f"[yellow]Warning:[/] {escape(warning)}", highlight=False)


def data_warnings(result: IdentificationResult) -> list[str]:
    """Return what was lost of each bag, or left out because a channel froze."""
    return [
        f"{Path(bag.path).name}: {sentence}"
        for bag in result.bags
        for sentence in (
            *(note.sentence for note in bag.notes if note.limits),
            *(each.sentence for each in bag.frozen),
        )
    ]


def print_next(
    console: Console, result: IdentificationResult, bags: Sequence[Path], config: Path
) -> None:
    """Name the command that looks for the cause of a model error, with its arguments."""
    from rich.text import Text

    from idim_iv_ros.cli.output import next_command

    if result.verdict.verdict == "misspecified":
        text = Text(f"Next: {next_command('diagnose', bags, config, '--out', 'why')}")
        console.print(text, soft_wrap=True)
