"""`idim-iv import`."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import Output
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import IMPORT_FORMAT

_table = partial(Option, metavar="FILE[:KEY]")


def import_command(
    out: Annotated[Path, Argument(metavar="OUT.mcap", help="The bag to write.")],
    position: str | None = _table(None, help="Measured positions."),
    effort: str | None = _table(None, help="Measured efforts; without: servos."),
    joints: str | None = Option(
        None, metavar="a,b,c", help="Names for the columns; of a data set JOINT=COLUMN."
    ),
    columns: Path | None = Option(
        None, metavar="MAP.yaml", help="A table and its columns; `idim-iv init TABLE`."
    ),
    lerobot: Path | None = Option(
        None, metavar="FOLDER", help="A LeRobot data set instead of tables."
    ),
    episode: int = Option(0, min=0, help="Of the data set."),
    scale: float = Option(1.0, help="Of the data set's positions to rad: 0.0174533 for degrees."),
    rate: float | None = Option(None, help="Samples per second."),
    time: str | None = _table(None, help="Stamps in s, instead of --rate."),
    velocity: str | None = _table(None),
    reference: str | None = _table(None, help="Position references."),
    velocity_reference: str | None = _table(None),
    reference_time: str | None = _table(None, help="Stamps of the references, if they differ."),
    link: str | None = _table(None, help="Positions of encoders behind the gears."),
    urdf: Path | None = Option(None, help="URDF to put on /robot_description."),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Turn tables (.csv .npy .npz .mat .parquet .h5) or a LeRobot episode into a bag.

    KEY is a variable (.npz, .mat) or comma-separated columns: their names (.parquet, the first
    line of a .csv), or their numbers, counted from 0 (d.csv:0,1). A few rows of NaN or impossible
    values are imported as missing, with a warning; more than 1 % are refused.

    Example: idim-iv import r.mcap --rate 1000 --position d.mat:q --effort d.mat:tau --joints a,b
    """
    from idim_iv_ros.model import read_urdf_file
    from idim_iv_ros.recording import import_mapped, import_table
    from idim_iv_ros.recording.lerobot import import_lerobot

    output = Output(quiet=quiet, as_json=as_json)
    names = [name.strip() for name in joints.split(",")] if joints is not None else []
    if not all(names) or len(set(names)) != len(names):
        raise UsageError(f"--joints {joints}: different names separated by commas are needed")
    described = None if urdf is None else read_urdf_file(urdf)
    if columns is not None:
        summary = import_mapped(out, columns, robot_description=described, force=force)
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
    elif position is None or not names:
        raise UsageError("give --columns MAP.yaml, --position and --joints, or --lerobot FOLDER")
    else:
        summary = import_table(
            out,
            joints=names,
            position=position,
            effort=effort,
            rate=rate,
            time=time,
            velocity=velocity,
            reference=reference,
            velocity_reference=velocity_reference,
            reference_time=reference_time,
            link=link,
            robot_description=described,
            force=force,
        )
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
