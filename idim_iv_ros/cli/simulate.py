"""`idim-iv simulate`."""

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from idim_iv_ros.cli.arguments import Config, progress_bar
from idim_iv_ros.cli.doubts import print_doubts
from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.excitation import random_motion, read_trajectory
from idim_iv_ros.model import configured_robot, read_urdf_file
from idim_iv_ros.simulated_recording import SimulatedBag, simulate


def simulate_command(
    config: Config,
    out: Annotated[
        Path, typer.Option("--out", metavar="BAG.mcap", help="The bag.", show_default=False)
    ],
    trajectory: Annotated[
        Path | None,
        typer.Option(
            metavar="TRAJ.csv",
            help="References, as `idim-iv excite` writes them; without it a random exciting motion "
            "of --duration seconds within the limits of the URDF.",
        ),
    ] = None,
    duration: Annotated[float, typer.Option(min=1.0, help="Seconds of the random motion.")] = 10.0,
    motion_seed: Annotated[int, typer.Option(min=0, help="Of the random motion.")] = 1,
    seed: Annotated[
        list[int] | None,
        typer.Option(min=0, help="Of the noise; several write several bags, BAG-SEED.mcap."),
    ] = None,
    effects: Annotated[
        Path | None,
        typer.Option(
            metavar="gap.json",
            help="A diagnosis: the robot has its extended parameters and its accepted effects.",
        ),
    ] = None,
) -> None:
    """Write the recording of a simulated robot, whose true parameters are known.

    The robot is that of the URDF, with what the configuration says under `simulated_robot`. Beside
    the bag stands BAG.truth.json with its true base parameters. With --effects it is the extended
    model of `idim-iv diagnose`.

    Example: idim-iv simulate --config config/tx40.yaml --out tx40.mcap --effects gap.json --seed 1
    """
    configuration = load_configuration(config)
    with progress_bar() as progress:
        if trajectory is None:
            period = configuration.controller.period or 0.001
            motion = random_motion(
                configuration, duration=duration, rate=1.0 / period, seed=motion_seed
            )
        else:
            motion = read_trajectory(trajectory)
        bags, truth = simulate(
            configuration,
            out,
            motion,
            seeds=tuple(seed or [1]),
            effects=effects,
            progress=progress,
        )
    console = Console()
    print_doubts(console, _doubts(configuration))
    console.print(_table(configuration.robot.joints, bags))
    for bag in bags:
        console.print(
            f"{bag.path}: {bag.samples} samples, {bag.duration:.4g} s at {bag.rate:.5g} Hz, "
            f"noise seed {bag.seed}",
            highlight=False,
            soft_wrap=True,
        )
    console.print(f"True base parameters: {truth}", highlight=False, soft_wrap=True)


def _doubts(configuration: Configuration) -> tuple[str, ...]:
    urdf = configuration.robot.urdf
    if urdf is None:
        return ()
    return configured_robot(configuration, read_urdf_file(urdf), urdf.name).doubts


def _table(joints: list[str], bags: list[SimulatedBag]) -> Table:
    table = Table(title="Largest over the recording", title_justify="left")
    table.add_column("joint")
    table.add_column("effort", justify="right")
    table.add_column("tracking error", justify="right")
    for column, joint in enumerate(joints):
        torque = max(float(bag.peak_torque[column]) for bag in bags)
        error = max(float(bag.peak_error[column]) for bag in bags)
        prismatic = bags[0].joint_types[column] == "prismatic"
        units = ("N", "mm") if prismatic else ("N m", "mrad")
        table.add_row(joint, f"{torque:.3g} {units[0]}", f"{1e3 * error:.3g} {units[1]}")
    return table
