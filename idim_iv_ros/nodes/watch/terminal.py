"""The live view as a table on the terminal."""

import math
from collections.abc import Sequence

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from idim_iv_ros.nodes.watch.state import BEYOND, GOOD, JointView, LiveView

_WIDTH = 14  # of the bar
_LARGEST = 4.0  # share of the noise floor at its end
_STYLES = {GOOD: "green", BEYOND: "bold red"}


def live_table(view: LiveView) -> RenderableType:
    """Return the table of all joints, what is beyond its limit, and a line for each node.

    The bar is the RMS of the residual over ten seconds of motion, over the noise floor, with marks
    at 1 and at what scatter and uncertain parameters explain. It fits a terminal of 80 columns.
    """
    lines: list[RenderableType] = [Text(f"{view.robot or 'robot'}: efforts", style="bold")]
    if view.joints:
        lines.append(_joints(view.joints))
    if view.reason:
        lines.append(Text(f"nothing is predicted: {view.reason}", style="yellow"))
    elif math.isfinite(view.delay):
        lines.append(Text(f"{view.delay:.2f} s behind the robot", style="dim"))
    lines += [
        Text(f"{joint.name}: {joint.sentence}", style="red")
        for joint in view.joints
        if joint.level == BEYOND
    ]
    lines += [Text(f"{node}: {what}", style="dim") for node, what in view.nodes.items()]
    return Group(*lines)


def _joints(joints: Sequence[JointView]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, expand=False)
    table.add_column("joint")
    for heading in ("measured", "predicted", "residual"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("÷ noise floor", no_wrap=True)
    table.add_column("10 s", justify="right", no_wrap=True)
    table.add_column("1 s", justify="right", no_wrap=True)
    for joint in joints:
        style = _STYLES.get(joint.level, "cyan")
        table.add_row(
            f"{joint.name} ({joint.unit})" if joint.unit else joint.name,
            _number(joint.measured),
            _number(joint.predicted),
            _number(joint.residual),
            _bar(joint, style),
            Text(_share(joint.level_share), style=style),
            _share(joint.share),
        )
    return table


def _number(number: float) -> str:
    return f"{number:+.3f}" if math.isfinite(number) else "–"


def _share(share: float) -> str:
    return f"{share:.2f}" if math.isfinite(share) else "–"


def _bar(joint: JointView, style: str) -> Text:
    """Share of the noise floor as a bar with marks at 1 and at the limit."""
    filled = 0
    if math.isfinite(joint.level_share):
        filled = min(round(_WIDTH * joint.level_share / _LARGEST), _WIDTH)
    text = Text()
    marks = {round(_WIDTH / _LARGEST): "┊"}
    if math.isfinite(joint.limit):
        marks[min(round(_WIDTH * joint.limit / _LARGEST), _WIDTH - 1)] = "│"
    for place in range(_WIDTH):
        if place in marks:
            text.append(marks[place], style="dim" if marks[place] == "┊" else "bold")
        else:
            text.append("█" if place < filled else "·", style=style if place < filled else "dim")
    return text
