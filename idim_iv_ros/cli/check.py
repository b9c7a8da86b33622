"""`idim-iv check`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console
from rich.padding import Padding
from rich.text import Text

from idim_iv_ros.cli.arguments import AsJson, Bags, Config, Quiet, Verbose
from idim_iv_ros.cli.output import LONGEST, Output, next_command, print_table
from idim_iv_ros.errors import DataError

if TYPE_CHECKING:
    from idim_iv_ros.identification.check import CheckReport

_STYLES = {"good": "green", "limited": "yellow", "unusable": "red"}


def check_command(
    bags: Bags,
    config: Config,
    quiet: Quiet = False,
    as_json: AsJson = False,
    verbose: Verbose = False,
) -> None:
    """Say whether recordings can support an identification, per joint and per parameter.

    Exit status 1 if they cannot.

    Example: idim-iv check run1.mcap --config ur5.yaml
    """
    from idim_iv_ros.configuration import load_configuration

    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    with output.progress() as progress:
        from idim_iv_ros.identification.check import check

        report = check(bags, configuration, progress)
    output.document(report.to_document())
    _print_report(output.console, report, verbose)
    if not report.usable:
        first, *others = [f for f in report.findings if f.level == "unusable"]
        more = f" (and {len(others)} more)" if others else ""
        raise DataError(f"not usable for an identification: {first.where}: {first.sentence}{more}")
    limits = sum(finding.level == "limited" for finding in report.findings)
    plural = "s" if limits > 1 else ""
    output.line(f"Usable, with {limits} limit{plural} named above." if limits else "Usable.")
    output.line(f"Next: {next_command('identify', bags, config, '--out', 'results')}")


def _print_report(console: Console, report: CheckReport, whole: bool) -> None:
    """Print the findings on every recording and joint, and what the excitation shows."""

    def print_indented(*parts: str | tuple[str, str]) -> None:
        console.print(Padding(Text.assemble(*parts), (0, 0, 0, 2), expand=False))

    for where in dict.fromkeys(finding.where for finding in report.findings):
        console.print(Text(where, style="bold"), soft_wrap=True)
        for finding in report.findings:
            if finding.where == where:
                level = "" if finding.level == "good" else f"{finding.level}: "
                print_indented((level, _STYLES[finding.level]), finding.sentence)
    if report.condition_number is None:
        return
    console.print(
        f"\nWhat the excitation shows (condition number {report.condition_number:.3g}; the "
        "residual of least squares is taken as white, so that these are lower bounds):"
    )
    for seen, words in (("well", "well, σ ≤ 10 %"), ("yes", "σ ≤ 30 %")):
        names = [parameter.name for parameter in report.parameters if parameter.seen == seen]
        if names:
            print_indented(f"{words}: {' '.join(names)}")
    poorly = [
        (p.name, "" if p.smallest is None else f"{p.smallest:.2g}", p.unit)
        for p in report.parameters
        if p.seen == "poorly"
    ]
    if poorly:
        columns = ("parameter", ">visible from (2σ)", "unit")
        most = None if whole else LONGEST
        print_table(console, "Seen poorly, or small", columns, poorly, most=most)
