"""What a running robot and its nodes say at one moment, and that as a table on the terminal."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from idim_iv_ros.prediction.rows import LIMIT, SHARE

GOOD, BEYOND, UNKNOWN = "good", "beyond", "unknown"
_WIDTH = 14  # characters of the bar
_LARGEST = 4.0  # share of the noise floor at the end of the bar
_STYLES = {GOOD: "green", BEYOND: "bold red"}


@dataclass(frozen=True)
class JointView:
    """One joint: what the predictor's diagnostics say of it, and its newest prediction.

    Attributes
    ----------
    name, unit : str
        `unit` is empty before the predictor has said it.
    measured, predicted, residual : float
        In `unit`; NaN where there is none.
    share : float
        RMS of the residual over the last second of motion, over the noise floor of the
        identification; NaN where not known.
    level_share, limit : float
        RMS of the residual over ten seconds of motion, over the same noise floor, and how much of
        it is explained; NaN where not known.
    level : str
        ``good``, ``beyond`` the limit, or ``unknown``.
    sentence : str
        Of the predictor's diagnostics.
    """

    name: str
    unit: str = ""
    measured: float = math.nan
    predicted: float = math.nan
    residual: float = math.nan
    share: float = math.nan
    level_share: float = math.nan
    limit: float = math.nan
    level: str = UNKNOWN
    sentence: str = ""

    @classmethod
    def diagnosed(
        cls, name: str, values: Mapping[str, str], warns: bool, sentence: str
    ) -> "JointView":
        """Return a joint without a prediction, from the key-value pairs of its diagnostics."""
        share, limit = (_parsed(values.get(key, "")) for key in (SHARE, LIMIT))
        level = BEYOND if warns else GOOD if math.isfinite(limit) else UNKNOWN
        unit = values.get("unit", "")
        return cls(name, unit, level_share=share, limit=limit, level=level, sentence=sentence)


@dataclass(frozen=True)
class LiveView:
    """All joints, and what the nodes do.

    Attributes
    ----------
    robot : str
    stamp : float
        Of the sample, s.
    delay : float
        From the sample to its prediction, s.
    reason : str
        Why nothing is predicted; empty where something is.
    joints : tuple of JointView
    nodes : dict of str to str
        What recorder and identifier do and whether parameters drift, in words.
    """

    robot: str
    stamp: float
    delay: float
    reason: str
    joints: tuple[JointView, ...]
    nodes: dict[str, str] = field(default_factory=dict)

    def to_document(self) -> dict[str, object]:
        """Return plain values for JSON; numbers that do not exist are None."""
        joints = [
            {
                key: _finite(value) if isinstance(value, float) else value
                for key, value in vars(joint).items()
            }
            for joint in self.joints
        ]
        return {**vars(self), "delay": _finite(self.delay), "joints": joints}


def _parsed(text: str) -> float:
    try:
        return float(text)
    except ValueError:  # "unknown", or nothing
        return math.nan


def _finite(number: float) -> float | None:
    return float(f"{number:.6g}") if math.isfinite(number) else None


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
        newest = (joint.measured, joint.predicted, joint.residual)
        style = _STYLES.get(joint.level, "cyan")
        table.add_row(
            f"{joint.name} ({joint.unit})" if joint.unit else joint.name,
            *(_text(number, "+.3f") for number in newest),
            _bar(joint, style),
            Text(_text(joint.level_share, ".2f"), style=style),
            _text(joint.share, ".2f"),
        )
    return table


def _text(number: float, form: str) -> str:
    return f"{number:{form}}" if math.isfinite(number) else "–"


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
