"""`idim-iv import`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import Output
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.files import IMPORT_FORMAT


def import_command(
    out: Annotated[Path, Argument(metavar="OUT.mcap", help="The bag to write.")],
    columns: Annotated[
        Path,
        Option(
            metavar="MAP.yaml", help="A table and its columns; `idim-iv init TABLE` proposes it."
        ),
    ],
    urdf: Path | None = Option(None, help="URDF to put on /robot_description."),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Turn a table (.csv .npy .npz .mat .parquet .h5) into a bag.

    A few rows of NaN or impossible values are imported as missing, with a warning; more than 1 %
    are refused.

    Example: idim-iv init log.csv --out map.yaml; idim-iv import run.mcap --columns map.yaml
    """
    from idim_iv_ros.model import read_urdf_file
    from idim_iv_ros.recording import import_table

    output = Output(quiet=quiet, as_json=as_json)
    described = None if urdf is None else read_urdf_file(urdf)
    summary = import_table(out, columns, robot_description=described, force=force)
    signals = list(summary.signals)
    output.warn(summary.warnings)
    about = asdict(summary) | {"path": str(out), "signals": signals}
    output.document({"format": IMPORT_FORMAT, **about})
    output.line(
        f"{out}: {summary.samples} samples, {summary.duration:.4g} s at "
        f"{summary.rate:.5g} per second: {', '.join(signals)}"
    )
    option = " --urdf FILE" if described is None else ""
    output.line(f"Next: idim-iv init {shell_command(str(out))}{option} --out my_arm.yaml")
