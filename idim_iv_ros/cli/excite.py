"""`idim-iv excite`."""

from __future__ import annotations

import math
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from idim_iv_ros.cli.arguments import AsJson, Config, Force, Quiet, Verbose
from idim_iv_ros.errors import UsageError

_FOURIER = "For identification"
_SEGMENTS = "For diagnosis"
_LEAST_MESSAGE_RATES = {"identification": 20.0, "diagnosis": 100.0}
# Between points controllers fit quintics; so many for each period of the fastest content.
_POINTS_PER_PERIOD = 5.0


class CriterionName(str, Enum):
    """What a design for identification minimises."""

    condition = "condition"
    precision = "precision"


class Purpose(str, Enum):
    """What a motion is for."""

    identification = "identification"
    diagnosis = "diagnosis"


def excite_command(
    config: Config,
    out: Annotated[
        Path,
        typer.Option("--out", metavar="TRAJ", help="Writes TRAJ.csv, .yaml, .json."),
    ],
    purpose: Annotated[
        Purpose, typer.Option("--for", help="Estimate parameters, or separate the causes of a gap.")
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
        typer.Option(
            help="Points per second of the YAML. Default: 5 a period of the fastest content, at "
            "least 20 (diagnosis: 100)."
        ),
    ] = None,
    criterion: Annotated[
        CriterionName,
        typer.Option(help="Least condition number, or least standard deviations (faster motion)."),
    ] = CriterionName.condition,
    seed: Annotated[
        int, typer.Option(min=0, help="Of the random starts, and of the multisine's phases.")
    ] = 1,
    period: Annotated[
        float, typer.Option(help="Identification: seconds of a period.", rich_help_panel=_FOURIER)
    ] = 10.0,
    repeats: Annotated[int, typer.Option(help="Periods.", rich_help_panel=_FOURIER)] = 3,
    harmonics: Annotated[
        int, typer.Option(help="Harmonics of 1 / period.", rich_help_panel=_FOURIER)
    ] = 5,
    torque_noise: Annotated[
        float,
        typer.Option(
            help="σ of the torque, share of each limit, to predict σ from.",
            rich_help_panel=_FOURIER,
        ),
    ] = 0.005,
    time_limit: Annotated[
        float, typer.Option(help="Seconds for the search.", rich_help_panel=_FOURIER)
    ] = 120.0,
    duration: Annotated[
        float, typer.Option(help="Budget in seconds.", rich_help_panel=_SEGMENTS)
    ] = 180.0,
    force: Force = False,
    quiet: Quiet = False,
    as_json: AsJson = False,
    verbose: Verbose = False,
) -> None:
    """Design a motion within the robot's limits that shows its parameters well.

    Example: idim-iv excite --config ur5.yaml --out run --floor 0.05
    """
    import numpy as np

    from idim_iv_ros.cli.excitation_tables import print_diagnosis, print_excitation
    from idim_iv_ros.cli.output import Output, print_doubts
    from idim_iv_ros.configuration import load_configuration
    from idim_iv_ros.excitation import (
        DesignSettings,
        design_diagnosis,
        diagnosis_document,
        excite,
        load_model,
        motion_limits,
        require_message_rate,
        require_place,
        segment_table,
        write_motion,
    )
    from idim_iv_ros.excitation.files import ENDINGS

    output = Output(quiet=quiet, as_json=as_json)
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
    if message_rate is not None:
        require_message_rate(message_rate, rate)
    print_doubts(output.console, model.robot.doubts)
    endings = (*ENDINGS, "segments.csv") if purpose is Purpose.diagnosis else ENDINGS
    with require_place(out, endings, force=force), output.progress() as progress:
        if purpose is Purpose.diagnosis:
            diagnosis = design_diagnosis(
                model,
                limits,
                configuration,
                duration=duration,
                rate=rate,
                seed=seed,
                start=posture,
                progress=progress,
            )
            trajectory = diagnosis.trajectory
            document = diagnosis_document(model.robot.name, limits, diagnosis, seed)
            tables = {"segments.csv": segment_table(diagnosis.segments)}
            fastest = diagnosis.highest_frequency
        else:
            settings = DesignSettings(
                period, repeats, rate, harmonics, seed, time_limit, posture, criterion.value
            )
            excitation = excite(
                model, limits, settings, torque_noise=torque_noise, progress=progress
            )
            fastest = harmonics / period
            trajectory, document = excitation.design.trajectory, dict(excitation.document)
            tables = {}
        if message_rate is None:
            least = _LEAST_MESSAGE_RATES[purpose.value]
            message_rate = min(rate, max(least, _POINTS_PER_PERIOD * fastest))
        paths = write_motion(
            out, trajectory, document, message_rate=message_rate, tables=tables, force=force
        )
    output.document(document)
    if purpose is Purpose.diagnosis:
        print_diagnosis(output.console, model, limits, diagnosis)
    else:
        print_excitation(output.console, model, limits, excitation, whole=verbose)
    output.line("Written: " + " ".join(map(str, paths)))
    output.line(
        f"Next: run {paths[0].name} on the robot and record it: "
        f"idim-iv record --config {config} --out bags"
    )


def _numbers(option: str, text: str) -> list[float]:
    """Finite numbers separated by commas."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise UsageError(f"{option} {text}: numbers separated by commas are needed") from error
    if not all(map(math.isfinite, values)):
        raise UsageError(f"{option} {text}: finite numbers are needed")
    return values
