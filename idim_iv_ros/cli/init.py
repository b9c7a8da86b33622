"""`idim-iv init` and `idim-iv import`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from idim_iv_ros.cli import output as shared
from idim_iv_ros.cli.output import Output, next_command, print_table
from idim_iv_ros.encoding import shell_command
from idim_iv_ros.files import IMPORT_FORMAT, INIT_FORMAT, require_file_place, write_together


def init_command(
    bags: shared.Bags,
    urdf: Path | None = Option(
        None, help="The robot's URDF; may be left out where the bag has /robot_description."
    ),
    driver: str | None = Option(
        None,
        help="Topics and units of a driver: ur, franka, kinova, kuka_fri, "
        "ros2_control, or a YAML file with the same keys.",
    ),
    out: Path | None = Option(
        None, help="The configuration to write; my_arm.yaml, of a table map.yaml."
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Write a first configuration from what a bag holds, every key with a comment.

    Joints, topics, the unit of the efforts and the control law are proposed, with the reasons. Of
    a table (.csv .h5 .parquet .npz .mat) it writes a map of the columns for `idim-iv import`.

    Example: idim-iv init run1.mcap --urdf ur5.urdf --out ur5.yaml
    """
    from idim_iv_ros.recording.table import SUFFIXES as TABLES
    from idim_iv_ros.signal_source import NO_EFFORT

    output = Output(quiet=quiet, as_json=as_json)
    if bags[0].suffix.lower() in TABLES:
        _propose_map(output, bags[0], out or Path("map.yaml"), force=force)
        return
    out = out or Path("my_arm.yaml")
    require_file_place([out], force=force)
    with output.progress() as progress:
        from idim_iv_ros.first_configuration.proposal import (
            propose_configuration,
            write_configuration,
        )

        proposal = propose_configuration(bags, urdf, driver=driver, progress=progress)
        write_configuration(proposal, out, force=force)
    values, reasons = proposal.values_for(out), proposal.reasons
    document = {
        "format": INIT_FORMAT,
        "path": str(out),
        "configuration": values,
        "reasons": {".".join(key): reason for key, reason in reasons.items()},
        "left_out": dict(proposal.left_out),
        "warnings": list(proposal.warnings),
    }
    output.document(document)
    rows = []
    for section, keys in values.items():
        for name, value in keys.items():
            text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
            rows.append((f"{section}.{name}", text, reasons.get((section, name), "")))
    if "reference" not in proposal.values["signals"]:
        rows.append(("signals.reference", "none", reasons["signals", "reference"]))
    print_table(output.console, "", ("key", "value", "why"), rows)
    if proposal.left_out:
        print_table(output.console, "Left out", ("joint", "why"), list(proposal.left_out.items()))
    output.warn(proposal.warnings)
    output.line(f"Written: {out}")
    servo = values["signals"].get("effort") == NO_EFFORT
    following = ("servo", "--out", "servos") if servo else ("check",)
    output.line(f"Next: {next_command(following[0], bags, out, *following[1:])}")


def _propose_map(output: Output, table: Path, out: Path, *, force: bool) -> None:
    from idim_iv_ros.recording.table import proposed_map

    require_file_place([out], force=force)
    text = proposed_map(table)
    if table.parent.resolve() != out.parent.resolve():
        text = text.replace(f"file: '{table.name}'", f"file: '{table.resolve()}'", 1)
    write_together({out: text})
    output.line(text.rstrip())
    output.line(f"Written: {out}: correct it where it is wrong")
    bag = shell_command(f"{table.stem}.mcap")
    output.line(f"Next: idim-iv import {bag} --columns {shell_command(str(out))}")


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
    from idim_iv_ros.recording.table import import_table

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
