"""What `make demo` runs: identify the simulated arm and compare with what it really is."""

import json
import os
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from idim_iv_ros import identify, load_configuration, write_report
from idim_iv_ros.cli.identify import print_verdict
from idim_iv_ros.cli.output import print_table, shown_progress
from idim_iv_ros.errors import IdimError

FOLDER = Path(__file__).parent
CONFIG = FOLDER.parent / "config" / "arm6.yaml"


def demo(out: Annotated[Path, typer.Option(help="Folder for the report.")]) -> None:
    """Identify bags/arm6.mcap and print the estimates beside the true values."""
    console = Console(highlight=False)
    console.print(
        "Identifying a simulated six-joint arm from bags/arm6.mcap with config/arm6.yaml.\n"
        "The arm is 10 to 30 % off what the URDF says; the true values are used only to compare."
    )
    truth = json.loads((FOLDER / "arm6.truth.json").read_text(encoding="utf-8"))
    with shown_progress() as progress:
        # As a user at the project's root would name them: the page repeats it in its commands.
        bag, config = (Path(os.path.relpath(path)) for path in (FOLDER / "arm6.mcap", CONFIG))
        result = identify([bag], load_configuration(config), progress=progress)
        _, html = write_report(result, out, config=config)
    rows = [
        (
            parameter.name,
            f"{parameter.value:.4g}",
            f"{parameter.std:.2g}",
            f"{truth[parameter.name]:.4g}",
            f"{(parameter.value - truth[parameter.name]) / parameter.std:+.1f} σ",
            parameter.unit,
        )
        for parameter in result.parameters
        if parameter.essential
    ]
    columns = ("parameter", ">value", ">σ", ">truth", ">off by", "unit")
    print_table(console, f"{result.robot}: essential parameters", columns, rows)
    print_verdict(console, result)
    within = [
        abs(parameter.value - truth[parameter.name]) < 3.0 * parameter.std
        for parameter in result.parameters
    ]
    console.print(f"{sum(within)} of {len(within)} base parameters lie within 3 σ of the truth.")
    console.print(f"Report: {html}", soft_wrap=True)


if __name__ == "__main__":
    try:
        typer.run(demo)
    except IdimError as error:
        print(f"demo: {error}", file=sys.stderr)
        sys.exit(error.exit_status)
