"""`idim-iv excite`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rich.console import Console
from typer import Context, Option

from idim_iv_ros.cli import output as shared
from idim_iv_ros.cli.output import Output, print_table
from idim_iv_ros.errors import UsageError

if TYPE_CHECKING:
    from idim_iv_ros.excitation.diagnosis import Diagnosis
    from idim_iv_ros.excitation.excite import Excitation
    from idim_iv_ros.excitation.limits import LimitUse, MotionLimits
    from idim_iv_ros.model import InverseModel

_fourier = partial(Option, rich_help_panel="For identification")
_LEAST_MESSAGE_RATES = {"identification": 20.0, "diagnosis": 100.0, "servo": 100.0}
# Between points controllers fit quintics; so many for each period of the fastest content.
_POINTS_PER_PERIOD = 5.0
_CONDITION_NUMBERS = {
    "weighted": "rows over torque limit",
    "plain": "plain, SI units",
    "equilibrated": "weighted, columns of unit length",
    "deviation": "mean deviation of a sample, noise of the torque limit, SI",
}


# Purposes that have an option.
_IDENTIFICATION = ("period", "repeats", "harmonics", "torque_noise", "time_limit", "criterion")
_PURPOSES = {
    **dict.fromkeys(_IDENTIFICATION, ("identification",)),
    "duration": ("diagnosis",),
    "start": ("identification", "diagnosis"),
}


def excite_command(
    context: Context,
    config: shared.Config,
    out: Annotated[Path, Option("--out", metavar="TRAJ", help="Writes TRAJ.csv, .yaml, .json.")],
    purpose: Literal["identification", "diagnosis", "servo"] = Option(
        "identification",
        "--for",
        help="Estimate parameters, separate the causes of a gap, or identify servos "
        "without torques (20 s).",
    ),
    floor: float | None = Option(
        None, help="Height all moving frames stay above, m in the base frame."
    ),
    margin: float = Option(0.9, help="Share of each limit that may be used."),
    acceleration: str | None = Option(
        None,
        metavar="A[,A…]",
        help="Limit in rad/s² (m/s²), one or one a joint. Default: half of the torque "
        "limit on the joint's mean inertia, and full speed in 0.1 s at most.",
    ),
    start: str | None = Option(
        None, metavar="Q,Q,…", help="Posture at rest, rad (m). Default: chosen."
    ),
    rate: float = Option(1000.0, help="Samples per second of the CSV."),
    criterion: Literal["condition", "precision"] = _fourier(
        "condition", help="Least condition number, or least standard deviations (faster motion)."
    ),
    seed: int = Option(1, min=0, help="Of the random starts, and of the multisine's phases."),
    period: float = _fourier(10.0, help="Identification: seconds of a period."),
    repeats: int = _fourier(3, help="Periods."),
    harmonics: int = _fourier(5, help="Harmonics of 1 / period."),
    torque_noise: float = _fourier(
        0.005, help="σ of the torque, share of each limit, to predict σ from."
    ),
    time_limit: float = _fourier(120.0, help="Seconds for the search."),
    duration: float = Option(180.0, help="Budget in seconds.", rich_help_panel="For diagnosis"),
    force: shared.Force = False,
    quiet: shared.Quiet = False,
    as_json: shared.AsJson = False,
) -> None:
    """Design a motion within the robot's limits that shows its parameters well.

    Example: idim-iv excite --config ur5.yaml --out run --floor 0.05
    """
    import numpy as np

    from idim_iv_ros.configuration import load_configuration
    from idim_iv_ros.excitation import excite as motions
    from idim_iv_ros.excitation.design import DesignSettings
    from idim_iv_ros.excitation.diagnosis import design_diagnosis
    from idim_iv_ros.excitation.limits import motion_limits

    for name, purposes in _PURPOSES.items():
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE" and purpose not in purposes:
            option, where = name.replace("_", "-"), " and ".join(purposes)
            raise UsageError(f"--{option} belongs to --for {where}, and this is --for {purpose}")
    output = Output(quiet=quiet, as_json=as_json)
    configuration = load_configuration(config)
    model = motions.load_model(configuration)
    given = None if acceleration is None else shared.numbers("--acceleration", acceleration)
    limits = motion_limits(model, configuration, margin=margin, acceleration=given, floor=floor)
    posture = None if start is None else np.array(shared.numbers("--start", start))
    output.warn(model.robot.doubts)
    motions.require_place(out, force=force)
    with output.progress() as progress:
        if purpose == "diagnosis":
            how: dict[str, Any] = {"duration": duration, "rate": rate, "start": posture}
            how |= {"seed": seed, "progress": progress}
            diagnosis = design_diagnosis(model, limits, configuration, **how)
            trajectory, fastest = diagnosis.trajectory, diagnosis.highest_frequency
            document = motions.diagnosis_document(model.robot.name, limits, diagnosis, seed)
        elif purpose == "servo":
            trajectory, fastest, document = motions.servo_motion(
                configuration, limits, rate=rate, seed=seed
            )
        else:
            settings = DesignSettings(
                period, repeats, rate, harmonics, seed, time_limit, posture, criterion
            )
            excitation = motions.excite(
                model, limits, settings, torque_noise=torque_noise, progress=progress
            )
            trajectory, fastest = excitation.design.trajectory, harmonics / period
            document = dict(excitation.document)
        points = min(rate, max(_LEAST_MESSAGE_RATES[purpose], _POINTS_PER_PERIOD * fastest))
        paths = motions.write_motion(out, trajectory, document, message_rate=points, force=force)
    output.document(document)
    if purpose == "diagnosis":
        _print_segments(output.console, model, limits, diagnosis)
    elif purpose == "identification":
        _print_excitation(output.console, model, limits, excitation)
    output.line("Written: " + " ".join(map(str, paths)))
    output.line(
        f"Next: run {paths[0].name} on the robot and record it: "
        f"idim-iv record --config {config} --out bags"
    )


def _print_excitation(
    console: Console, model: InverseModel, limits: MotionLimits, excitation: Excitation
) -> None:
    from idim_iv_ros.excitation.design import BAD_DEVIATION, BAD_SHARE

    design = excitation.design
    console.print(
        f"{model.robot.name}: condition number of the base regressor, {len(model.base.names)} "
        "parameters with friction"
    )
    rows = [
        (words, *(f"{getattr(numbers, name):.4g}" for numbers in (design.before, design.after)))
        for name, words in _CONDITION_NUMBERS.items()
    ]
    print_table(console, "", ("", ">random (median)", ">designed"), rows)
    _print_limits(console, model, limits, design.use)
    poorly = [parameter.name for parameter in excitation.parameters if parameter.bad]
    console.print(
        f"Seen poorly, or small: {', '.join(poorly) or 'none'} (of "
        f"{len(excitation.parameters)} base parameters; under torque noise of "
        f"{100 * excitation.torque_noise:g} % of each limit "
        f"σ above {100 * BAD_DEVIATION:g} % of the nominal value, or less than "
        f"{100 * BAD_SHARE:g} % of the column unexplained by the others; the JSON file has every σ)"
    )
    console.print(
        f"{design.trajectory.duration:g} s at {design.trajectory.rate:g} per second, searched "
        f"{design.seconds:.0f} s"
    )
    if design.ended_early:
        console.print(
            "[yellow]The time limit ended the search early[/]: more time finds a better motion, "
            "and another run may find another one."
        )


def _print_limits(
    console: Console, model: InverseModel, limits: MotionLimits, use: LimitUse
) -> None:
    console.print(f"Largest share of each limit (allowed: {100 * limits.margin:g} %)")
    shares = (use.position, use.velocity, use.acceleration, use.torque)
    rows = [
        (joint, *("?" if share is None else f"{100 * share[k]:.0f} %" for share in shares))
        for k, joint in enumerate(model.robot.joints)
    ]
    columns = ("joint", ">position", ">velocity", ">acceleration", ">torque")
    print_table(console, "", columns, rows)
    if use.torque is None:
        console.print(
            "[yellow]Torques were not checked[/]: the URDF gives no mass to the moving links."
        )
    floor = "" if limits.floor is None else f" (floor {limits.floor:g} m)"
    console.print(
        f"Lowest moving frame: {use.lowest_frame} at {use.lowest_height:.3f} m{floor}; only frame "
        "origins are looked at, not shapes, and no collisions"
    )


def _print_segments(
    console: Console, model: InverseModel, limits: MotionLimits, diagnosis: Diagnosis
) -> None:
    from idim_iv_ros.excitation.diagnosis import NOT_REVEALED

    segments, seconds = diagnosis.segments, diagnosis.trajectory.duration
    console.print(f"{model.robot.name}: {len(segments)} segments, {seconds:.4g} s")
    rows = []
    for kind in dict.fromkeys(segment.kind for segment in segments):
        same = [segment for segment in segments if segment.kind == kind]
        seconds = sum(segment.end - segment.start for segment in same)
        rows.append((kind, str(len(same)), f"{seconds:.1f}", ", ".join(same[0].effects)))
    print_table(console, "", ("segments", ">of them", ">seconds", "reveal"), rows)
    _print_limits(console, model, limits, diagnosis.use)
    console.print(f"Not revealed: {', '.join(NOT_REVEALED)} (see the JSON file)")
