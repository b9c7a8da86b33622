"""`idim-iv replay`."""

from __future__ import annotations

from pathlib import Path

from typer import Option

from idim_iv_ros.cli import arguments as shared
from idim_iv_ros.cli.output import Output, print_table
from idim_iv_ros.files import REPLAY

_TITLES = {
    "tracking": "Position, simulation less recording (rms, ± half of the 95 % interval)",
    "torque": "Torque, simulation less recording",
}


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
        help="What the robot has beyond the model: a file of effects, or a diagnosis, whose "
        "parameters are taken too where --model is urdf.",
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
