"""What `idim-iv excite` prints of a motion."""

from rich.console import Console

from idim_iv_ros.cli.table import print_table
from idim_iv_ros.excitation import Diagnosis, Excitation, LimitUse, MotionLimits
from idim_iv_ros.excitation.criterion import BAD_DEVIATION, BAD_SHARE
from idim_iv_ros.excitation.segments import NOT_REVEALED
from idim_iv_ros.model import InverseModel


def print_excitation(
    console: Console,
    model: InverseModel,
    limits: MotionLimits,
    excitation: Excitation,
    *,
    whole: bool = True,
) -> None:
    """Condition numbers, limits used, and the parameters that stay badly excited."""
    design = excitation.design
    console.print(
        f"{model.robot.name}: condition number of the base regressor, {len(model.base.names)} "
        "parameters with friction",
        highlight=False,
    )
    columns = ["", ">random (median)", ">designed"]
    kinds = (
        ("rows over torque limit", "weighted"),
        ("plain, SI units", "plain"),
        ("weighted, columns of unit length", "equilibrated"),
        ("mean deviation of a sample, noise of the torque limit, SI", "deviation"),
    )
    rows = [
        (words, f"{getattr(design.before, name):.4g}", f"{getattr(design.after, name):.4g}")
        for words, name in kinds
    ]
    print_table(console, "", columns, rows)
    if excitation.criterion == "condition":
        console.print(
            "A slow motion and a fast one have the same condition number: --criterion precision "
            "finds the motion with the smallest standard deviations."
        )
    print_use(console, model, limits, design.use)
    _print_parameters(console, excitation, whole)
    console.print(
        f"{design.trajectory.duration:g} s at {design.trajectory.rate:g} per second, searched "
        f"{design.seconds:.0f} s",
        highlight=False,
    )
    if design.ended_early:
        console.print(
            "[yellow]The time limit ended the search early[/]: more time finds a better motion, "
            "and another run may find another one."
        )


def print_use(console: Console, model: InverseModel, limits: MotionLimits, use: LimitUse) -> None:
    """Largest share of each limit, joint by joint."""
    console.print(
        f"Largest share of each limit (allowed: {100 * limits.margin:g} %)", highlight=False
    )
    headings = ("position", "velocity", "acceleration", "torque")
    columns = ["joint", *(f">{heading}" for heading in headings)]
    rows = []
    for index, joint in enumerate(model.robot.joints):
        shares = (use.position, use.velocity, use.acceleration)
        cells = [f"{100 * share[index]:.0f} %" for share in shares]
        cells.append("?" if use.torque is None else f"{100 * use.torque[index]:.0f} %")
        rows.append((joint, *cells))
    print_table(console, "", columns, rows)
    if use.torque is None:
        console.print(
            "[yellow]Torques were not checked[/]: the URDF gives no mass to the moving links."
        )
    floor = "" if limits.floor is None else f" (floor {limits.floor:g} m)"
    console.print(
        f"Lowest moving frame: {use.lowest_frame} at {use.lowest_height:.3f} m{floor}; only frame "
        "origins are looked at, not shapes, and no collisions",
        highlight=False,
    )


def _print_parameters(console: Console, excitation: Excitation, whole: bool) -> None:
    parameters = excitation.parameters
    bad = [parameter for parameter in parameters if parameter.bad]
    valued = sum(parameter.relative_std is not None for parameter in parameters)
    console.print(
        f"Predicted under torque noise of {100 * excitation.torque_noise:g} % of each limit: "
        f"{valued} of {len(parameters)} base parameters have a nominal value; {len(bad)} are seen "
        f"poorly, or small: σ above {100 * BAD_DEVIATION:g} % of the nominal value, or less than "
        f"{100 * BAD_SHARE:g} % of the column unexplained by the others",
        highlight=False,
    )
    if not bad:
        return
    headings = ("nominal", "predicted σ", "%σ", "unexplained")
    columns = ["parameter", *(f">{heading}" for heading in headings)]
    columns.append("unit")
    rows = []
    for parameter in bad:
        relative = parameter.relative_std
        rows.append(
            (
                parameter.name,
                f"{parameter.given:.3g}",
                f"{parameter.std:.2g}",
                "" if relative is None else f"{100 * relative:.2g}",
                f"{100 * parameter.unexplained:.2g} %",
                parameter.unit,
            )
        )
    rest = "--verbose prints them, and the JSON file has them"
    print_table(console, "", columns, rows, whole=whole, rest=rest)


def print_diagnosis(
    console: Console, model: InverseModel, limits: MotionLimits, diagnosis: Diagnosis
) -> None:
    """Segments by kind with the effects that they reveal, and the limits used."""
    count = len(diagnosis.segments)
    console.print(
        f"{model.robot.name}: {count} segments, {diagnosis.trajectory.duration:.4g} s",
        highlight=False,
    )
    columns = [
        "segments",
        ">of them",
        ">seconds",
        "reveal",
    ]
    rows = []
    for kind in dict.fromkeys(segment.plan.kind for segment in diagnosis.segments):
        same = [segment for segment in diagnosis.segments if segment.plan.kind == kind]
        seconds = sum(segment.end - segment.start for segment in same)
        rows.append((kind, str(len(same)), f"{seconds:.1f}", ", ".join(same[0].effects)))
    print_table(console, "", columns, rows)
    print_use(console, model, limits, diagnosis.use)
    frequencies = ", ".join(f"{f:.2g}" for f in diagnosis.bandwidth)
    words = "taken" if diagnosis.bandwidth_known else "[yellow]not known, assumed[/]"
    console.print(f"Bandwidth of the position loops: {words}: {frequencies} Hz", highlight=False)
    console.print("Not revealed: " + ", ".join(NOT_REVEALED) + " (see the JSON file)")
