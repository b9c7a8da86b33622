"""`idim-iv import`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import Output
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import IMPORT_FORMAT


def import_command(
    out: Annotated[Path, Argument(metavar="OUT.mcap", help="The bag to write.")],
    columns: Path | None = Option(
        None, metavar="MAP.yaml", help="A table and its columns; `idim-iv init TABLE` proposes it."
    ),
    lerobot: Path | None = Option(
        None, metavar="FOLDER", help="A LeRobot data set instead of a table."
    ),
    episode: int = Option(0, min=0, help="Of the data set."),
    joints: str | None = Option(
        None, metavar="JOINT=COLUMN,…", help="Of the data set; left out, all columns of its state."
    ),
    scale: float = Option(1.0, help="Of the data set's positions to rad: 0.0174533 for degrees."),
    urdf: Path | None = Option(None, help="URDF to put on /robot_description."),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Turn a table (.csv .npy .npz .mat .parquet .h5) or a LeRobot episode into a bag.

    A few rows of NaN or impossible values are imported as missing, with a warning; more than 1 %
    are refused.

    Example: idim-iv init log.csv --out map.yaml; idim-iv import run.mcap --columns map.yaml
    """
    from idim_iv_ros.model import read_urdf_file
    from idim_iv_ros.recording import import_table
    from idim_iv_ros.recording.lerobot import import_lerobot

    output = Output(quiet=quiet, as_json=as_json)
    names = [name.strip() for name in joints.split(",")] if joints is not None else []
    if not all(names) or len(set(names)) != len(names):
        raise UsageError(f"--joints {joints}: different names separated by commas are needed")
    described = None if urdf is None else read_urdf_file(urdf)
    if columns is not None:
        summary = import_table(out, columns, robot_description=described, force=force)
    elif lerobot is not None:
        summary = import_lerobot(
            out,
            lerobot,
            episode=episode,
            joints=names or None,
            scale=scale,
            robot_description=described,
            force=force,
        )
    else:
        raise UsageError("give --columns MAP.yaml or --lerobot FOLDER")
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
