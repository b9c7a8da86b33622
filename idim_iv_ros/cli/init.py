"""`idim-iv init`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from idim_iv_ros.cli.arguments import AsJson, Bags, Force, Quiet

if TYPE_CHECKING:
    from rich.console import Console

    from idim_iv_ros.first_configuration import Proposal


def init_command(
    bags: Bags,
    urdf: Annotated[
        Path | None,
        typer.Option(
            "--urdf", help="The robot's URDF; may be left out where the bag has /robot_description."
        ),
    ] = None,
    driver: Annotated[
        str | None,
        typer.Option(
            "--driver",
            help="Topics and units of a driver: ur, franka, kinova, kuka_fri, ros2_control, or a "
            "YAML file with the same keys.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option("--out", help="The configuration to write.")] = Path(
        "my_arm.yaml"
    ),
    force: Force = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Write a first configuration from what a bag holds, every key with a comment.

    Joints, topics, the unit of the efforts and the control law are proposed, with the reasons.

    Example: idim-iv init run1.mcap --urdf ur5.urdf --out ur5.yaml
    """
    from idim_iv_ros.cli.output import Output, next_command
    from idim_iv_ros.files import INIT_FORMAT, require_file_place

    output = Output(quiet=quiet, as_json=as_json)
    require_file_place([out], force=force)
    with output.progress() as progress:
        from idim_iv_ros.first_configuration import propose_configuration, write_configuration

        proposal = propose_configuration(bags, urdf, driver=driver, progress=progress)
        write_configuration(proposal, out, force=force)
    output.document(
        {
            "format": INIT_FORMAT,
            "path": str(out),
            "configuration": proposal.values_for(out),
            "reasons": {".".join(key): reason for key, reason in proposal.reasons.items()},
            "left_out": dict(proposal.left_out),
            "warnings": list(proposal.warnings),
        }
    )
    output.warn_quietly(proposal.warnings)
    _print_proposal(output.console, proposal, out)
    output.line(f"Written: {out}")
    output.line(f"Next: {next_command('check', bags, out)}")


def _print_proposal(console: Console, proposal: Proposal, out: Path) -> None:
    from rich.text import Text

    from idim_iv_ros.cli.table import print_table

    rows = []
    for section, keys in proposal.values_for(out).items():
        for name, value in keys.items():
            shown = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append((f"{section}.{name}", shown, proposal.reasons.get((section, name), "")))
    if "reference" not in proposal.values["signals"]:
        rows.append(("signals.reference", "none", proposal.reasons["signals", "reference"]))
    print_table(console, "", ["key", "value", "why"], rows)
    if proposal.left_out:
        left_out = list(proposal.left_out.items())
        print_table(console, "Left out", ["joint", "why"], left_out)
    for warning in proposal.warnings:
        console.print(Text.assemble(("Warning: ", "yellow"), warning))
