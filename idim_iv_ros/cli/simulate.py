"""`idim-iv simulate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import Output, next_command, print_marked, print_table
from idim_iv_ros.files import SIMULATION_FORMAT


def simulate_command(
    config: shared.Config,
    out: Annotated[Path, Option("--out", metavar="BAG.mcap", help="The bag.")],
    trajectory: Path | None = Option(
        None,
        metavar="TRAJ.csv",
        help="References, as `idim-iv excite` writes them; without it a random exciting motion "
        "of --duration seconds within the limits of the URDF.",
    ),
    duration: float = Option(10.0, min=1.0, help="Seconds of the random motion."),
    motion_seed: int = Option(1, min=0, help="Of the random motion."),
    seed: list[int] | None = Option(
        None, min=0, help="Of the noise; several write several bags, BAG-SEED.mcap."
    ),
    effects: Path | None = Option(
        None,
        metavar="gap.json",
        help="A diagnosis: the robot has its extended parameters and its accepted effects. "
        "Or a file of effects written by hand (docs/simulation.md).",
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Write the recording of a simulated robot, whose true parameters are known.

    The robot is that of the URDF, with what the configuration says under `simulated_robot`. Its
    true base parameters are written beside the bag, to BAG.truth.json. With --effects it is the
    extended model of `idim-iv diagnose`.

    Example: idim-iv simulate --config config/tx40.yaml --out tx40.mcap --effects gap.json --seed 1
    """
    from idim_iv_ros.configuration import load_configuration

    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    with output.progress() as progress:
        from idim_iv_ros.excitation import random_motion, read_trajectory
        from idim_iv_ros.model import configured_robot, read_urdf_file
        from idim_iv_ros.model.parameters import unit_at
        from idim_iv_ros.simulators import recording

        seeds = tuple(seed or [1])
        if trajectory is None:
            rate = 1.0 / (configuration.controller.period or 0.001)
            motion = random_motion(configuration, duration=duration, rate=rate, seed=motion_seed)
        else:
            motion = read_trajectory(trajectory)
        bags, truth = recording.simulate(
            configuration, out, motion, seeds=seeds, effects=effects, force=force, progress=progress
        )
    written = [bag.to_document() for bag in bags]
    output.document({"format": SIMULATION_FORMAT, "bags": written, "truth": str(truth)})
    if (urdf := configuration.robot.description) is not None:
        robot = configured_robot(configuration, read_urdf_file(urdf), urdf.name)
        print_marked(output.console, "Warning", robot.doubts, "yellow")
    rows = []
    for column, (joint, kind) in enumerate(
        zip(configuration.robot.joints, bags[0].joint_types, strict=True)
    ):
        torque = max(float(bag.peak_torque[column]) for bag in bags)
        error = max(1e3 * float(bag.peak_error[column]) for bag in bags)
        peaks = ((torque, "N m"), (error, "mrad"))
        rows.append((joint, *(f"{peak:.3g} {unit_at(unit, kind)}" for peak, unit in peaks)))
    columns = ("joint", ">effort", ">tracking error")
    print_table(output.console, "Largest over the recording", columns, rows)
    for bag in bags:
        output.line(
            f"{bag.path}: {bag.samples} samples, {bag.duration:.4g} s at {bag.rate:.5g} Hz, "
            f"noise seed {bag.seed}"
        )
    output.line(f"True base parameters: {truth}")
    paths = [bag.path for bag in bags]
    output.line(f"Next: {next_command('identify', paths, config, '--out', 'results')}")
