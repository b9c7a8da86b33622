"""`idim-iv import`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from idim_iv_ros.errors import UsageError
from idim_iv_ros.recording import import_table
from idim_iv_ros.text_file import read_text


def import_command(
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap", help="The bag to write.")],
    position: Annotated[str, typer.Option(metavar="FILE[:KEY]", help="Measured positions.")],
    effort: Annotated[str, typer.Option(metavar="FILE[:KEY]", help="Measured efforts.")],
    joints: Annotated[str, typer.Option(metavar="a,b,c", help="Names for the columns.")],
    rate: Annotated[float | None, typer.Option(help="Samples per second.")] = None,
    time: Annotated[
        str | None, typer.Option(metavar="FILE[:KEY]", help="Stamps in s, instead of --rate.")
    ] = None,
    velocity: Annotated[str | None, typer.Option(metavar="FILE[:KEY]")] = None,
    reference: Annotated[
        str | None, typer.Option(metavar="FILE[:KEY]", help="Position references.")
    ] = None,
    velocity_reference: Annotated[str | None, typer.Option(metavar="FILE[:KEY]")] = None,
    reference_time: Annotated[
        str | None,
        typer.Option(metavar="FILE[:KEY]", help="Stamps of the references, if they differ."),
    ] = None,
    urdf: Annotated[Path | None, typer.Option(help="URDF to put on /robot_description.")] = None,
) -> None:
    """Turn tables (.csv .npy .npz .mat) into a bag.

    KEY is a variable, or comma-separated columns.

    Example: idim-iv import r.mcap --rate 1000 --position d.mat:q --effort d.mat:tau --joints a,b
    """
    names = [name.strip() for name in joints.split(",")]
    if not all(names) or len(set(names)) != len(names):
        raise UsageError(f"--joints {joints}: different names separated by commas are needed")
    description = None
    if urdf is not None:
        description = read_text(urdf, "the URDF", megabytes=50.0)
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
        robot_description=description,
    )
    Console().print(
        f"{out}: {summary.samples} samples of {len(names)} joints, {summary.duration:.4g} s at "
        f"{summary.rate:.5g} per second: {', '.join(summary.signals)}",
        highlight=False,
        soft_wrap=True,
    )
