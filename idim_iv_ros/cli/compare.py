"""`idim-iv compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from idim_iv_ros.cli import arguments as shared

_FILE = "compare.html"


def compare_command(
    first: Annotated[Path, typer.Argument(help="A result.json of `idim-iv identify`.")],
    second: Annotated[Path, typer.Argument(help="Another one of the same robot.")],
    out: Annotated[
        Path | None, typer.Option("--out", help=f"Folder for {_FILE}, both side by side.")
    ] = None,
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
    verbose: shared.Verbose = False,
) -> None:
    """Say in which parameters two identifications of one robot differ.

    Example: idim-iv compare monday/result.json friday/result.json --out compared
    """
    from idim_iv_ros.cli.output import Output
    from idim_iv_ros.cli.table import LONGEST, print_table
    from idim_iv_ros.files import write_together
    from idim_iv_ros.identification.compare import compare_results
    from idim_iv_ros.report import require_writable
    from idim_iv_ros.report.compare import compare_html
    from idim_iv_ros.report.numerals import measured, number

    output = Output(quiet=quiet, as_json=as_json)
    comparison = compare_results(first, second)
    if out is not None:
        with require_writable(out, (_FILE,), force=force):
            write_together({out / _FILE: compare_html(comparison)})
    output.document(comparison.to_document())
    print_table(
        output.console,
        f"{comparison.robot}: base parameters, those that differ most first",
        ("parameter", ">first (± 95 %)", ">second (± 95 %)", "unit", ">difference"),
        [
            (
                pair.name,
                " ".join(measured(pair.first, pair.first_std)),
                " ".join(measured(pair.second, pair.second_std)),
                pair.unit,
                f"{number(pair.deviations, 2)} σ",
            )
            for pair in comparison.pairs
        ],
        most=None if verbose else LONGEST,
    )
    output.console.print(comparison.sentence)
    if out is not None:
        output.line(f"Report: {out / _FILE}")
