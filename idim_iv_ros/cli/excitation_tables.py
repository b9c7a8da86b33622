"""What `idim-iv excite` prints of a motion."""

from rich.console import Console

from idim_iv_ros.cli.output import LONGEST, print_table
from idim_iv_ros.excitation import Diagnosis, Excitation, LimitUse, MotionLimits
from idim_iv_ros.excitation.criterion import BAD_DEVIATION, BAD_SHARE
from idim_iv_ros.excitation.segments import NOT_REVEALED
from idim_iv_ros.model import InverseModel

_CONDITION_NUMBERS = {
    "weighted": "rows over torque limit",
    "plain": "plain, SI units",
    "equilibrated": "weighted, columns of unit length",
    "deviation": "mean deviation of a sample, noise of the torque limit, SI",
}


def print_excitation(
    console: Console,
    model: InverseModel,
    limits: MotionLimits,
    excitation: Excitation,
    *,
    whole: bool = True,
) -> None:
    """Print condition numbers, limits used, and the parameters that stay badly excited."""
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
    if excitation.criterion == "condition":
        console.print(
            "A slow motion and a fast one have the same condition number: --criterion precision "
            "finds the motion with the smallest standard deviations."
        )
    _print_limits(console, model, limits, design.use)
    _print_parameters(console, excitation, whole)
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
    """Print the largest share of each limit joint by joint, and the lowest moving frame."""
    console.print(f"Largest share of each limit (allowed: {100 * limits.margin:g} %)")
    rows = []
    for index, joint in enumerate(model.robot.joints):
        shares = (use.position, use.velocity, use.acceleration, use.torque)
        cells = ("?" if share is None else f"{100 * share[index]:.0f} %" for share in shares)
        rows.append((joint, *cells))
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


def _print_parameters(console: Console, excitation: Excitation, whole: bool) -> None:
    """Print the parameters that the motion shows poorly, with their predicted deviations."""
    bad = [parameter for parameter in excitation.parameters if parameter.bad]
    valued = sum(parameter.relative_std is not None for parameter in excitation.parameters)
    console.print(
        f"Predicted under torque noise of {100 * excitation.torque_noise:g} % of each limit: "
        f"{valued} of {len(excitation.parameters)} base parameters have a nominal value; "
        f"{len(bad)} are seen poorly, or small: σ above {100 * BAD_DEVIATION:g} % of the nominal "
        f"value, or less than {100 * BAD_SHARE:g} % of the column unexplained by the others"
    )
    if not bad:
        return
    rows = [
        (
            parameter.name,
            f"{parameter.given:.3g}",
            f"{parameter.std:.2g}",
            "" if parameter.relative_std is None else f"{100 * parameter.relative_std:.2g}",
            f"{100 * parameter.unexplained:.2g} %",
            parameter.unit,
        )
        for parameter in bad
    ]
    columns = ("parameter", ">nominal", ">predicted σ", ">%σ", ">unexplained", "unit")
    rest = "--verbose prints them, and the JSON file has them"
    print_table(console, "", columns, rows, most=None if whole else LONGEST, rest=rest)


def print_segments(
    console: Console, model: InverseModel, limits: MotionLimits, diagnosis: Diagnosis
) -> None:
    """Print the segments by kind with the effects that they reveal, and the limits used."""
    segments = diagnosis.segments
    console.print(
        f"{model.robot.name}: {len(segments)} segments, {diagnosis.trajectory.duration:.4g} s"
    )
    rows = []
    for kind in dict.fromkeys(segment.kind for segment in segments):
        same = [segment for segment in segments if segment.kind == kind]
        seconds = sum(segment.end - segment.start for segment in same)
        rows.append((kind, str(len(same)), f"{seconds:.1f}", ", ".join(same[0].effects)))
    print_table(console, "", ("segments", ">of them", ">seconds", "reveal"), rows)
    _print_limits(console, model, limits, diagnosis.use)
    frequencies = ", ".join(f"{frequency:.2g}" for frequency in diagnosis.bandwidth)
    words = "taken" if diagnosis.bandwidth_known else "[yellow]not known, assumed[/]"
    console.print(f"Bandwidth of the position loops: {words}: {frequencies} Hz")
    console.print(f"Not revealed: {', '.join(NOT_REVEALED)} (see the JSON file)")
