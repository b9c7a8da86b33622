"""`idim-iv excite`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer

from idim_iv_ros.cli import arguments as shared

_fourier = partial(typer.Option, rich_help_panel="For identification")
_LEAST_MESSAGE_RATES = {"identification": 20.0, "diagnosis": 100.0, "servo": 100.0}
# Between points controllers fit quintics; so many for each period of the fastest content.
_POINTS_PER_PERIOD = 5.0


def excite_command(
    config: shared.Config,
    out: Annotated[
        Path, typer.Option("--out", metavar="TRAJ", help="Writes TRAJ.csv, .yaml, .json.")
    ],
    purpose: Annotated[
        Literal["identification", "diagnosis", "servo"],
        typer.Option(
            "--for",
            help="Estimate parameters, separate the causes of a gap, or identify servos "
            "without torques (20 s).",
        ),
    ] = "identification",
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
        typer.Option(
            help="Points per second of the YAML. Default: 5 a period of the fastest content, at "
            "least 20 (diagnosis: 100)."
        ),
    ] = None,
    criterion: Annotated[
        Literal["condition", "precision"],
        typer.Option(help="Least condition number, or least standard deviations (faster motion)."),
    ] = "condition",
    seed: Annotated[
        int, typer.Option(min=0, help="Of the random starts, and of the multisine's phases.")
    ] = 1,
    period: Annotated[float, _fourier(help="Identification: seconds of a period.")] = 10.0,
    repeats: Annotated[int, _fourier(help="Periods.")] = 3,
    harmonics: Annotated[int, _fourier(help="Harmonics of 1 / period.")] = 5,
    torque_noise: Annotated[
        float, _fourier(help="σ of the torque, share of each limit, to predict σ from.")
    ] = 0.005,
    time_limit: Annotated[float, _fourier(help="Seconds for the search.")] = 120.0,
    duration: Annotated[
        float, typer.Option(help="Budget in seconds.", rich_help_panel="For diagnosis")
    ] = 180.0,
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
    verbose: shared.Verbose = False,
) -> None:
    """Design a motion within the robot's limits that shows its parameters well.

    Example: idim-iv excite --config ur5.yaml --out run --floor 0.05
    """
    import numpy as np

    from idim_iv_ros import excitation as motions
    from idim_iv_ros.cli.excitation_tables import print_excitation, print_segments
    from idim_iv_ros.cli.output import Output, print_marked
    from idim_iv_ros.configuration import load_configuration
    from idim_iv_ros.excitation.files import ENDINGS

    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    model = motions.load_model(configuration)
    given = None if acceleration is None else shared.numbers("--acceleration", acceleration)
    limits = motions.motion_limits(
        model,
        configuration,
        margin=margin,
        acceleration=given,
        floor=floor,
    )
    posture = None if start is None else np.array(shared.numbers("--start", start))
    if message_rate is not None:
        motions.require_message_rate(message_rate, rate)
    print_marked(output.console, "Warning", model.robot.doubts, "yellow")
    segments = {"segments.csv"} if purpose == "diagnosis" else set()
    motions.require_place(out, (*ENDINGS, *segments), force=force)
    with output.progress() as progress:
        if purpose == "diagnosis":
            diagnosis = motions.design_diagnosis(
                model,
                limits,
                configuration,
                duration=duration,
                rate=rate,
                seed=seed,
                start=posture,
                progress=progress,
            )
            trajectory, fastest = diagnosis.trajectory, diagnosis.highest_frequency
            document = motions.diagnosis_document(model.robot.name, limits, diagnosis, seed)
            tables = {"segments.csv": motions.segment_table(diagnosis.segments)}
        elif purpose == "servo":
            trajectory, fastest, document = motions.servo_motion(
                configuration, limits, rate=rate, seed=seed
            )
            tables = {}
        else:
            settings = motions.DesignSettings(
                period, repeats, rate, harmonics, seed, time_limit, posture, criterion
            )
            excitation = motions.excite(
                model, limits, settings, torque_noise=torque_noise, progress=progress
            )
            trajectory, fastest = excitation.design.trajectory, harmonics / period
            document, tables = dict(excitation.document), {}
        if message_rate is None:
            least = _LEAST_MESSAGE_RATES[purpose]
            message_rate = min(rate, max(least, _POINTS_PER_PERIOD * fastest))
        paths = motions.write_motion(
            out, trajectory, document, message_rate=message_rate, tables=tables, force=force
        )
    output.document(document)
    if purpose == "diagnosis":
        print_segments(output.console, model, limits, diagnosis)
    elif purpose == "identification":
        print_excitation(output.console, model, limits, excitation, whole=verbose)
    output.line("Written: " + " ".join(map(str, paths)))
    output.line(
        f"Next: run {paths[0].name} on the robot and record it: "
        f"idim-iv record --config {config} --out bags"
    )
