"""`idim-iv identify`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.console import Console
from rich.text import Text
from typer import Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import LONGEST, Output, next_command, print_marked, print_table
from idim_iv_ros.files import RESULT

if TYPE_CHECKING:
    from idim_iv_ros.diagnosis.result import GapResult
    from idim_iv_ros.identification.result import IdentificationResult


def identify_command(
    bags: shared.Bags,
    config: shared.Config,
    out: shared.OutOrJson = None,
    estimator: Literal["idim-iv", "idim-ls"] = Option(
        "idim-iv", help="Instrumental variables, or least squares."
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Identify the dynamic parameters, test them, write result.json and report.html.

    Example: idim-iv identify run1.mcap run2.mcap --config ur5.yaml --out results
    """
    output = Output(quiet=quiet, as_json=as_json)
    with output.progress():  # while the libraries are loaded
        from idim_iv_ros.identification.identify import identify
    result, numbers, page = output.produce(
        identify, bags, config, RESULT, out, force=force, estimator=estimator
    )
    output.warn_quietly([*result.doubts, *data_warnings(result)])
    print_parameters(output.console, result)
    print_verdict(output.console, result)
    if result.verdict.verdict == "misspecified":
        output.line(f"Next: {next_command('diagnose', bags, config, '--out', 'why')}")
    print_physical(output, result, numbers, config)
    output.name_files(numbers, page)


def print_physical(
    output: Output,
    result: IdentificationResult | GapResult,
    numbers: Path | None,
    config: Path,
    *options: str,
) -> None:
    """Name the command that takes the answer into a simulator; else say why it cannot be."""
    if result.physical is None:
        if result.why_no_physical:
            output.line(f"No physical parameters for a simulator: {result.why_no_physical}")
        return
    if not result.physical.test.accepted:
        output.line(f"Physical parameters: {result.physical.sentence}")
    if numbers is not None:
        command = next_command("export", [numbers], config, *options, "--out", "simulator")
        output.line(f"Into a simulator: {command}")


def print_parameters(console: Console, result: IdentificationResult) -> None:
    """Print essential parameters with their standard deviations, the best determined first."""
    rows: list[tuple[float, tuple[str, ...]]] = []
    for parameter in result.parameters:
        value, std = parameter.essential_value, parameter.essential_std
        if not parameter.essential or value is None or std is None:
            continue
        percent = 100.0 * std / abs(value)
        cells = (f"{value:.4g}", f"{std:.2g}", f"{percent:.2g}", parameter.unit)
        rows.append((percent, (parameter.name, *cells, parameter.essential_remark)))
    print_table(
        console,
        f"{result.robot}: essential parameters, {result.estimator}, best determined first",
        ("parameter", ">value", ">σ", ">%σ", "unit", "remark"),
        [cells for _, cells in sorted(rows)],
        most=LONGEST,
        rest="the report has them",
    )
    console.print(
        "A base parameter is what a motion can show: the parameter of its name (M mass, MX … first "
        "moments, XX … inertias, Ia drive inertia, Fv viscous and Fc Coulomb friction, off "
        "constant torque; joint last) with what is grouped with it. Essential: the recording "
        "determines it.",
        style="dim",
    )


def print_verdict(console: Console, result: IdentificationResult) -> None:
    """Print verdict, fit, where the instruments came from, and what was left out."""
    fit = result.fit
    lines = [
        f"{fit.essential_parameters} of {fit.base_parameters} base parameters are essential; "
        f"relative error {fit.relative_error_percent:.3g} % on {fit.samples} rows; "
        f"{result.iterations} iteration{'s' if result.iterations > 1 else ''}, "
        f"{'converged' if result.converged else 'NOT converged'}"
    ]
    if errors := fit.joint_relative_error_percent:
        percents = (
            f"{joint} {'–' if error is None else f'{error:.3g} %'}"
            for joint, error in errors.items()
        )
        lines.append(f"Relative error of the torque by joint: {', '.join(percents)}")
    lines.append(f"Instruments: {result.instruments.source}")
    lines.append(f"Verdict: {result.verdict.verdict}. {result.verdict.sentence}")
    for line in lines:
        console.print(Text(line))
    print_marked(console, "Warning", result.doubts, "yellow")
    print_marked(console, "Advice", result.processing.advice, "yellow")
    print_marked(console, "Warning", data_warnings(result), "yellow")


def data_warnings(result: IdentificationResult) -> list[str]:
    """Return what was lost of each bag, or left out because a channel froze."""
    warnings = []
    for bag in result.bags:
        sentences = [note.sentence for note in bag.notes if note.limits]
        sentences += [channel.sentence for channel in bag.frozen]
        warnings += [f"{Path(bag.path).name}: {sentence}" for sentence in sentences]
    return warnings
