"""`idim-iv excite`."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from idim_iv_ros.cli.arguments import Config, progress_bar
from idim_iv_ros.cli.excitation_tables import print_excitation
from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation import (
    DesignSettings,
    excite,
    load_model,
    motion_limits,
    require_place,
    write_motion,
)


class Purpose(str, Enum):
    """What a motion is for."""

    identification = "identification"


def excite_command(
    config: Config,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="TRAJ", help="Writes TRAJ.csv, .yaml, .json.", show_default=False
        ),
    ],
    purpose: Annotated[
        Purpose, typer.Option("--for", help="Estimate parameters, or tell causes of a gap apart.")
    ] = Purpose.identification,
    floor: Annotated[
        float | None, typer.Option(help="Height all moving frames stay above, m in the base frame.")
    ] = None,
    margin: Annotated[float, typer.Option(help="Share of each limit that may be used.")] = 0.9,
    acceleration: Annotated[
        str | None,
        typer.Option(
            metavar="A[,A…]",
            help="Limit in rad/s² (m/s²), one or one a joint. Default: half of the torque limit on "
            "the joint's mean inertia, and full speed in 0.1 s at most.",
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(metavar="Q,Q,…", help="Posture at rest, rad (m). Default: chosen."),
    ] = None,
    rate: Annotated[float, typer.Option(help="Samples per second of the CSV.")] = 1000.0,
    message_rate: Annotated[
        float | None,
        typer.Option(help="Points per second of the YAML. Default: 20."),
    ] = None,
    period: Annotated[float, typer.Option(help="Seconds of a period.")] = 10.0,
    repeats: Annotated[int, typer.Option(help="Periods.")] = 3,
    harmonics: Annotated[int, typer.Option(help="Harmonics of 1 / period.")] = 5,
    torque_noise: Annotated[
        float, typer.Option(help="σ of the torque, share of each limit, to predict σ from.")
    ] = 0.005,
    seed: Annotated[int, typer.Option(min=0, help="Of the random starts.")] = 1,
    time_limit: Annotated[float, typer.Option(help="Seconds for the search.")] = 120.0,
) -> None:
    """Design a motion within the robot's limits that shows its parameters well.

    Example: idim-iv excite --config ur5.yaml --out run --floor 0.05
    """
    configuration = load_configuration(config)
    model = load_model(configuration)
    limits = motion_limits(
        model,
        configuration,
        margin=margin,
        acceleration=None if acceleration is None else _numbers("--acceleration", acceleration),
        floor=floor,
    )
    posture = None if start is None else np.array(_numbers("--start", start))
    settings = DesignSettings(period, repeats, rate, harmonics, seed, time_limit, posture)
    with require_place(out):
        with progress_bar() as progress:
            excitation = excite(
                model, limits, settings, torque_noise=torque_noise, progress=progress
            )
        paths = write_motion(
            out,
            excitation.design.trajectory,
            excitation.document,
            message_rate=min(rate, 20.0) if message_rate is None else message_rate,
        )
    console = Console()
    print_excitation(console, model, limits, excitation)
    console.print("Written: " + " ".join(map(str, paths)), soft_wrap=True, highlight=False)


def _numbers(option: str, text: str) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise UsageError(f"{option} {text}: numbers separated by commas are needed") from error
    if not np.all(np.isfinite(values)):
        raise UsageError(f"{option} {text}: finite numbers are needed")
    return values
