"""`idim-iv compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import Output, print_table
from idim_iv_ros.files import signed, write_together

_FILE, _CONFIGURATION = "compare.html", "robot.yaml"
_SHOWN = 8  # rows at least, without --verbose


def compare_command(
    first: Annotated[Path, Argument(help="A result.json of `idim-iv identify`.")],
    second: Annotated[Path, Argument(help="Another one of the same robot.")],
    out: Path | None = Option(None, "--out", help=f"Folder for {_FILE}, both side by side."),
    config: Path | None = Option(
        None,
        help="The robot's YAML file, for the next command; left out, that of the second "
        f"result is written beside {_FILE}.",
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
    verbose: shared.Verbose = False,
) -> None:
    """Say in which parameters two identifications of one robot differ.

    Example: idim-iv compare monday/result.json friday/result.json --out compared
    """
    from idim_iv_ros.identification.compare import compare_results
    from idim_iv_ros.report import require_writable
    from idim_iv_ros.report.compare import compare_html, compare_step
    from idim_iv_ros.report.numerals import measured, number
    from idim_iv_ros.report.section import Files
    from idim_iv_ros.report.sections.provenance import configuration_text

    output = Output(quiet=quiet, as_json=as_json)
    comparison = compare_results(first, second)
    files = Files() if config is None else Files(str(config))
    if out is not None:
        written = {}
        if config is None:
            files = Files(str(out / _CONFIGURATION))
            written = {Path(files.config): signed(configuration_text(comparison.configuration))}
        written[out / _FILE] = compare_html(comparison, files)
        with require_writable(out, [path.name for path in written], force=force):
            write_together(written)
    output.document(comparison.to_document())
    print_table(
        output.console,
        f"{comparison.robot}: base parameters, those that differ most first",
        ("base parameter", ">first (± 95 %)", ">second (± 95 %)", "unit", ">difference"),
        [
            (
                pair.words,
                " ".join(measured(pair.first, pair.first_std)),
                " ".join(measured(pair.second, pair.second_std)),
                pair.unit,
                f"{number(pair.deviations, 2)} σ",
            )
            for pair in comparison.pairs
        ],
        most=None if verbose else max(_SHOWN, sum(pair.differs for pair in comparison.pairs)),
    )
    output.console.print(comparison.sentence)
    if out is not None or config is not None:
        output.line(f"Next: {compare_step(comparison, files).code}")
    if out is not None:
        output.line(f"Report: {out / _FILE}")
