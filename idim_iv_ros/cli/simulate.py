"""`idim-iv simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from idim_iv_ros.cli.arguments import AsJson, Config, Force, Quiet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from idim_iv_ros.configuration import Configuration
    from idim_iv_ros.simulators.recording import SimulatedBag


def simulate_command(
    config: Config,
    out: Annotated[Path, typer.Option("--out", metavar="BAG.mcap", help="The bag.")],
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
            help="A diagnosis: the robot has its extended parameters and its accepted effects. "
            "Or a file of effects written by hand (docs/simulation.md).",
        ),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Write the recording of a simulated robot, whose true parameters are known.

    The robot is that of the URDF, with what the configuration says under `simulated_robot`. Its
    true base parameters are written beside the bag, to BAG.truth.json. With --effects it is the
    extended model of `idim-iv diagnose`.

    Example: idim-iv simulate --config config/tx40.yaml --out tx40.mcap --effects gap.json --seed 1
    """
    from idim_iv_ros.cli.output import Output, next_command, print_doubts
    from idim_iv_ros.configuration import load_configuration

    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    with output.progress() as progress:
        from idim_iv_ros.excitation import random_motion, read_trajectory
        from idim_iv_ros.simulators.recording import (
            require_simulation_place,
            simulate,
            simulation_document,
        )

        seeds = tuple(seed or [1])
        require_simulation_place(out, seeds, force=force)

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
            seeds=seeds,
            effects=effects,
            force=force,
            progress=progress,
        )
    output.document(simulation_document(bags, truth))
    print_doubts(output.console, _doubts(configuration))
    _print_largest(output.console, configuration.robot.joints, bags)
    for bag in bags:
        output.line(
            f"{bag.path}: {bag.samples} samples, {bag.duration:.4g} s at {bag.rate:.5g} Hz, "
            f"noise seed {bag.seed}"
        )
    output.line(f"True base parameters: {truth}")
    paths = [bag.path for bag in bags]
    output.line(f"Next: {next_command('identify', paths, config, '--out', 'results')}")


def _doubts(configuration: Configuration) -> tuple[str, ...]:
    from idim_iv_ros.model import configured_robot, read_urdf_file

    urdf = configuration.robot.description
    if urdf is None:
        return ()
    return configured_robot(configuration, read_urdf_file(urdf), urdf.name).doubts


def _print_largest(console: Console, joints: list[str], bags: Sequence[SimulatedBag]) -> None:
    from idim_iv_ros.cli.table import print_table
    from idim_iv_ros.model.units import unit_at

    columns = [
        "joint",
        ">effort",
        ">tracking error",
    ]
    rows = []
    for column, joint in enumerate(joints):
        torque = max(float(bag.peak_torque[column]) for bag in bags)
        error = max(float(bag.peak_error[column]) for bag in bags)
        units = (unit_at(unit, bags[0].joint_types[column]) for unit in ("N m", "mrad"))
        cells = (f"{torque:.3g}", f"{1e3 * error:.3g}")
        shown = (f"{cell} {unit}" for cell, unit in zip(cells, units, strict=True))
        rows.append((joint, *shown))
    print_table(console, "Largest over the recording", columns, rows)
