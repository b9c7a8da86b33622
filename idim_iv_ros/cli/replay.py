"""`idim-iv replay`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from idim_iv_ros.cli.arguments import AsJson, Bags, Config, Force, OutOrJson, Picture, Quiet
from idim_iv_ros.files import REPLAY, REPORT

if TYPE_CHECKING:
    from rich.console import Console

    from idim_iv_ros.simulators.replay_result import ReplayResult


def replay_command(
    bags: Bags,
    config: Config,
    model: Annotated[
        str,
        typer.Option(
            metavar="urdf|ROBOT.xml",
            help="urdf: a MuJoCo model is made from the nominal model; or an MJCF file.",
        ),
    ] = "urdf",
    effects: Annotated[
        Path | None,
        typer.Option(
            metavar="effects.json|gap.json",
            help="What the robot has beyond the model: a file of effects, or a diagnosis, whose "
            "parameters are taken too where --model is urdf.",
        ),
    ] = None,
    out: OutOrJson = None,
    picture: Picture = None,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.mp4|gif",
            help="Write recorded and simulated robots side by side; needs something that draws.",
        ),
    ] = None,
    force: Force = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
) -> None:
    """Run the recorded references in MuJoCo, and say how far it is from the robot.

    Nominal, with corrected parameters, and with effects. Writes replay.json and report.html.

    Example: idim-iv replay run1.mcap --config ur5.yaml --effects why/gap.json --out replay
    """
    from idim_iv_ros.cli.output import Output
    from idim_iv_ros.configuration import load_configuration

    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    from idim_iv_ros.report import write_replay_report
    from idim_iv_ros.report.replay_picture import write_replay_picture
    from idim_iv_ros.simulators.mujoco_video import require_video, write_video
    from idim_iv_ros.simulators.replay import replay_bags, replayed_robot

    require_video(video, force=force)
    result, numbers, page = output.produce(
        lambda progress: replay_bags(
            bags, configuration, model=model, effects=effects, progress=progress
        ),
        lambda result: write_replay_report(result, out or "", force=force),
        write_replay_picture,
        out=out,
        names=(REPLAY, REPORT),
        picture=picture,
        force=force,
    )
    if video is not None:
        write_video(result, replayed_robot(bags, configuration), video)
    _print(output.console, result)
    output.warn(result.notes)
    output.name_files(numbers, page)
    if video is not None:
        output.line(f"Video: {video}")


def _print(console: Console, result: ReplayResult) -> None:
    from idim_iv_ros.cli.table import print_table
    from idim_iv_ros.report.replay import error_rows, headline

    drawn = [stage.name for stage in result.stages if stage.tracking is not None]
    columns = ["joint", *(f">{name}" for name in (*drawn, "noise"))]
    for kind, title in (
        ("tracking", "Position, simulation less recording (rms, ± half of the 95 % interval)"),
        ("torque", "Torque, simulation less recording"),
    ):
        print_table(console, title, columns, error_rows(result, kind))
    for stage in result.stages:
        if stage.note:
            console.print(f"{stage.name}: not simulated to its end: {stage.note}")
    console.print(headline(result))
