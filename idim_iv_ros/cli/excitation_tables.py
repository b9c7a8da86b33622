"""What `idim-iv excite` prints of a motion."""

from rich.console import Console
from rich.table import Table

from idim_iv_ros.excitation import Excitation, LimitUse, MotionLimits
from idim_iv_ros.excitation.prediction import BAD_DEVIATION, BAD_SHARE
from idim_iv_ros.model import InverseModel

_ROWS = 12


def print_excitation(
    console: Console, model: InverseModel, limits: MotionLimits, excitation: Excitation
) -> None:
    """Condition numbers, limits used, and the parameters that stay badly excited."""
    design = excitation.design
    table = Table(
        title=f"{model.robot.name}: condition number of the base regressor, "
        f"{len(model.base.names)} parameters with friction",
        title_justify="left",
    )
    for heading in ("", "random (median)", "designed"):
        table.add_column(heading, justify="right" if heading else "left")
    rows = (
        ("rows over torque limit (minimised)", "weighted"),
        ("plain, SI units", "plain"),
        ("weighted, columns of unit length", "equilibrated"),
    )
    for words, name in rows:
        table.add_row(
            words, f"{getattr(design.before, name):.4g}", f"{getattr(design.after, name):.4g}"
        )
    console.print(table)
    print_use(console, model, limits, design.use)
    _print_parameters(console, excitation)
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
    table = Table(
        title=f"Largest share of each limit (allowed: {100 * limits.margin:g} %)",
        title_justify="left",
    )
    table.add_column("joint")
    for heading in ("position", "velocity", "acceleration", "torque"):
        table.add_column(heading, justify="right")
    columns = [use.position, use.velocity, use.acceleration]
    for index, joint in enumerate(model.robot.joints):
        cells = [f"{100 * column[index]:.0f} %" for column in columns]
        cells.append("?" if use.torque is None else f"{100 * use.torque[index]:.0f} %")
        table.add_row(joint.replace("[", "\\["), *cells)
    console.print(table)
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


def _print_parameters(console: Console, excitation: Excitation) -> None:
    bad = [parameter for parameter in excitation.parameters if parameter.bad]
    noise = f"torque noise of {100 * excitation.torque_noise:g} % of the limit"
    if not bad:
        console.print(
            f"Every base parameter: predicted σ ≤ {100 * BAD_DEVIATION:g} % of its given value, "
            f"where that is not zero ({noise})",
            highlight=False,
        )
        return
    table = Table(
        title=f"{len(bad)} parameters seen poorly, or small: σ > {100 * BAD_DEVIATION:g} % of the "
        f"given value, or less than {100 * BAD_SHARE:g} % of the column unexplained; {noise}",
        title_justify="left",
    )
    table.add_column("parameter")
    for heading in ("given", "predicted σ", "%σ", "unexplained"):
        table.add_column(heading, justify="right")
    table.add_column("unit")
    for parameter in bad[:_ROWS]:
        relative = parameter.relative_std
        table.add_row(
            parameter.name,
            f"{parameter.given:.3g}",
            f"{parameter.std:.2g}",
            "" if relative is None else f"{100 * relative:.2g}",
            f"{100 * parameter.unexplained:.2g} %",
            parameter.unit,
        )
    console.print(table)
    if len(bad) > _ROWS:
        console.print(f"… and {len(bad) - _ROWS} more in the JSON file")
