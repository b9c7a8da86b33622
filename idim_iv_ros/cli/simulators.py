"""`idim-iv simulate`, `idim-iv export` and `idim-iv replay`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from idim_iv_ros.cli import output as shared
from idim_iv_ros.cli.output import Output, next_command, print_table
from idim_iv_ros.files import REPLAY, SIMULATION_FORMAT

_TITLES = {
    "tracking": "Position, simulation less recording (rms, ± half of the 95 % interval)",
    "torque": "Torque, simulation less recording",
}


def simulate_command(
    config: shared.Config,
    out: Annotated[Path, Option("--out", metavar="BAG.mcap", help="The bag.")],
    trajectory: Path | None = Option(
        None,
        metavar="TRAJ.csv",
        help="References, as `idim-iv excite` writes them; without it a random "
        "exciting motion of --duration seconds within the limits of the URDF.",
    ),
    duration: float = Option(10.0, min=1.0, help="Seconds of the random motion."),
    motion_seed: int = Option(1, min=0, help="Of the random motion."),
    seed: list[int] | None = Option(
        None, min=0, help="Of the noise; several write several bags, BAG-SEED.mcap."
    ),
    effects: Path | None = Option(
        None,
        metavar="gap.json",
        help="A diagnosis: the robot has its extended parameters and its accepted "
        "effects. Or a file of effects written by hand (docs/simulation.md).",
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
    import numpy as np

    from idim_iv_ros.configuration import load_configuration

    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    with output.progress() as progress:
        from idim_iv_ros.excitation.excite import random_motion
        from idim_iv_ros.excitation.trajectory import read_trajectory
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
        output.warn(configured_robot(configuration, read_urdf_file(urdf), urdf.name).doubts)
    torques = np.max([bag.peak_torque for bag in bags], axis=0)
    errors = 1e3 * np.max([bag.peak_error for bag in bags], axis=0)
    joints = zip(configuration.robot.joints, bags[0].joint_types, torques, errors, strict=True)
    rows = [
        (joint, f"{torque:.3g} {unit_at('N m', kind)}", f"{error:.3g} {unit_at('mrad', kind)}")
        for joint, kind, torque, error in joints
    ]
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


def export_command(
    result: Annotated[
        Path,
        Argument(
            metavar="RESULT.json|GAP.json",
            help="What `idim-iv identify` or `idim-iv diagnose` wrote.",
        ),
    ],
    config: shared.Config,
    out: shared.Out,
    refit: bool = Option(
        False,
        "--refit",
        help="Of a diagnosis all parameters of its refit, not the named causes alone.",
    ),
    without: list[str] | None = Option(
        None,
        metavar="CAUSE[@JOINT]",
        help="Leave out a named cause, for example payload; may be given again.",
    ),
    remainder: bool = Option(
        False,
        "--remainder",
        help="Spread what no cause explains over links and joints, as far as the "
        "recording asks for it.",
    ),
    randomize: bool = Option(
        False,
        "--randomize",
        help="The same, and ranges for domain randomisation: sample(model, rng) for MuJoCo.",
    ),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Write a result as URDF, MuJoCo model, effects, Isaac Lab actuators and a table of changes.

    Of a diagnosis: the URDF of the configuration with the named causes, a payload as a link of its
    own; of an identification: with its inertials, damping and friction. Nothing else changes. With
    robot.mjcf it is that MJCF, with armature too. Neither is written over.

    Example: idim-iv export why/gap.json --config ur5.yaml --out simulator
    """
    from idim_iv_ros.configuration import load_configuration
    from idim_iv_ros.simulator_files.export import export

    output = Output(quiet=quiet, as_json=as_json)
    how = {"refit": refit, "remainder": remainder, "randomize": randomize}
    configuration = load_configuration(config)
    paths = export(result, configuration, out, force=force, without=without or (), **how)
    files = [str(file) for file in paths.files]
    notes, missing = list(paths.notes), list(paths.not_native)
    output.document({"files": files, "not_native": missing, "notes": notes})
    for note in notes:
        output.line(f"Note: {note}")
    if missing:
        why = "MuJoCo has no element for" if paths.urdf else "Your MJCF was not given elements for"
        where = f"{paths.effects.name} holds them for its loop (docs/simulators.md)"
        output.line(f"{why} {', '.join(missing)}: {where}")
    for file in files:
        output.line(f"Written: {file}")
    output.line(f"What is new, and how sure it is: {paths.changes}")
    # A result has the names of its recordings alone: looked for where it and the configuration lie.
    folders = (Path(), *result.parents, config.parent)
    bags = [
        next((folder / name for folder in folders if (folder / name).exists()), Path(name))
        for name in paths.bags
    ]
    options = ("--model", str(paths.mjcf), "--effects", str(paths.effects), "--out", "replayed")
    output.line(f"Next: {next_command('replay', bags, config, *options)}")


def replay_command(
    bags: shared.Bags,
    config: shared.Config,
    model: str = Option(
        "urdf",
        metavar="urdf|ROBOT.xml",
        help="urdf: a MuJoCo model is made from the nominal model; or an MJCF file.",
    ),
    effects: Path | None = Option(
        None,
        metavar="effects.json|gap.json",
        help="What the robot has beyond the model: a file of effects, or a diagnosis, "
        "whose parameters are taken too where --model is urdf.",
    ),
    out: shared.OutOrJson = None,
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Run the recorded references in MuJoCo, and say how far it is from the robot.

    Nominal, with corrected parameters, and with effects. Writes replay.json and report.html.

    Example: idim-iv replay run1.mcap --config ur5.yaml --effects why/gap.json --out replay
    """
    from idim_iv_ros.report.replay import error_rows, headline
    from idim_iv_ros.simulators.replay import replay_bags

    output = Output(quiet=quiet, as_json=as_json)
    result, numbers, page = output.produce(
        replay_bags, bags, config, REPLAY, out, force=force, model=model, effects=effects
    )
    drawn = [stage.name for stage in result.stages if stage.tracking is not None]
    columns = ["joint", *(f">{name}" for name in (*drawn, "noise"))]
    for kind, title in _TITLES.items():
        print_table(output.console, title, columns, error_rows(result, kind))
    for stage in result.stages:
        if stage.note:
            output.console.print(f"{stage.name}: not simulated to its end: {stage.note}")
    output.console.print(headline(result))
    output.warn(result.notes)
    output.name_files(numbers, page)
