"""Figures of a fleet: robots of a type beside each other, and one quantity over time."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from idim_iv_ros.fleet.result import FleetRobot, FleetType, ParameterChange, TypeQuantity
from idim_iv_ros.report.figures import BLUE, GREY, ORANGE, Figure, axis, band, layout
from idim_iv_ros.report.numerals import number

_ROW = 26  # pixels of one quantity
_FARTHEST = 12.0  # deviations; what is farther is drawn there
_SCATTER = 0.28  # of a row, so that dots do not cover each other
_INTERVAL = 1.96


def distribution_figure(
    fleet_type: FleetType, robots: Sequence[FleetRobot], place: int
) -> Figure | None:
    """Return robots as dots, a row a quantity, in deviations from the mean of the type.

    None where no quantity has a mean and a scatter.
    """
    units = [
        _unit(quantity, column, robots) for column, quantity in enumerate(fleet_type.quantities)
    ]
    drawn = [
        (column, quantity)
        for column, quantity in enumerate(fleet_type.quantities)
        if math.isfinite(quantity.mean) and units[column] > 0.0
    ]
    if not drawn:
        return None
    shapes: list[dict[str, Any]] = []
    ordinary: list[tuple[float, float, str]] = []
    differing: list[tuple[float, float, str]] = []
    for row, (column, quantity) in enumerate(drawn):
        height = float(len(drawn) - 1 - row)
        shapes += _row_shapes(quantity, units[column], height)
        for number_of, robot in enumerate(robots):
            of_robot = robot.quantities[column]
            distance = _deviations(quantity, units[column], of_robot.value)
            if not math.isfinite(distance):
                continue
            # Golden ratio: neighbours in the list lie far from each other.
            shift = _SCATTER * (2.0 * ((number_of * 0.6180339887) % 1.0) - 1.0)
            words = f"{robot.robot}: {quantity.name} {number(of_robot.value, 4)} {quantity.unit}"
            side = max(-_FARTHEST, min(_FARTHEST, distance))
            (differing if of_robot.differs else ordinary).append((side, height + shift, words))
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "x": [round(x, 3) for x, _, _ in dots],
            "y": [round(y, 3) for _, y, _ in dots],
            "text": [words for _, _, words in dots],
            "marker": {"color": colour, "size": size, "opacity": opacity, "symbol": "diamond"},
            "hovertemplate": "%{text}<extra></extra>",
        }
        for dots, colour, size, opacity in ((ordinary, BLUE, 5, 0.55), (differing, ORANGE, 8, 1.0))
    ]
    names = [quantity.name for _, quantity in drawn]
    axes = {
        "xaxis": axis("Distance from the mean of the type, standard deviations of its robots",
                      range=[-_FARTHEST - 0.5, _FARTHEST + 0.5], dtick=2),
        "yaxis": axis("", tickvals=list(range(len(names))), ticktext=names[::-1],
                      range=[-0.6, len(names) - 0.4], showgrid=False),
    }  # fmt: skip
    words = f"Robots of type {fleet_type.type} beside each other, one row for each quantity"
    margin = {"l": 90, "r": 12, "t": 8, "b": 44}
    return Figure(
        f"distribution-{place}",
        70 + _ROW * len(names),
        words,
        data,
        layout(axes, shapes=shapes, margin=margin),
    )


def _row_shapes(quantity: TypeQuantity, unit: float, height: float) -> list[dict[str, Any]]:
    """Return plotly shapes of the intervals of next robot and mean, at a height."""
    low, high = (
        _deviations(quantity, unit, end) for end in (quantity.next_low, quantity.next_high)
    )
    first, last = (
        _deviations(quantity, unit, end) for end in (quantity.mean_low, quantity.mean_high)
    )
    shapes: list[dict[str, Any]] = []
    if math.isfinite(low) and math.isfinite(high):
        ends = max(low, -_FARTHEST), min(high, _FARTHEST)
        shapes.append(band(ends, (height - 0.36, height + 0.36)))
    shapes.append(
        {
            "type": "line",
            "x0": max(first, -_FARTHEST),
            "x1": min(last, _FARTHEST),
            "y0": height,
            "y1": height,
            "line": {"color": GREY, "width": 5},
            "layer": "below",
        }
    )
    return shapes


def _unit(quantity: TypeQuantity, column: int, robots: Sequence[FleetRobot]) -> float:
    """Return the standard deviation of the ordinary robots' estimates; 0 if there are too few."""
    values = [robot.quantities[column] for robot in robots]
    distances = [_deviations(quantity, 1.0, value.value) for value in values if not value.differs]
    finite = [distance for distance in distances if math.isfinite(distance)]
    return float(np.sqrt(np.mean(np.square(finite)))) if len(finite) > 1 else 0.0


def _deviations(quantity: TypeQuantity, unit: float, value: float) -> float:
    if quantity.kind == "residual":
        return math.log(value / quantity.mean) / unit if value > 0.0 else math.nan
    return (value - quantity.mean) / unit


def change_figure(change: ParameterChange, anchor: str) -> Figure:
    """Return a figure of one quantity of one robot over time, with the change found in it."""
    times = list(change.times)
    bars = [_INTERVAL * std for std in change.stds]
    dots = {
        "type": "scatter",
        "mode": "markers",
        "x": times,
        "y": list(change.values),
        "error_y": {"type": "data", "array": bars, "color": BLUE, "thickness": 1, "width": 0},
        "marker": {"color": BLUE, "size": 7, "symbol": "diamond"},
        "hovertemplate": f"%{{y:.4g}} {change.unit}, %{{x|%Y-%m-%d %H:%M}}<extra></extra>",
    }
    fitted = {
        "type": "scatter",
        "mode": "lines",
        "x": times,
        "y": list(change.fitted),
        "line": {"color": ORANGE, "width": 2, "shape": "hv" if change.kind == "step" else "linear"},
        "hoverinfo": "skip",
    }
    if change.kind == "step":
        # The level holds up to the first bag that is changed.
        before = int(np.searchsorted(times, change.begin))
        fitted["x"] = [times[0], change.begin, change.begin, times[-1]]
        fitted["y"] = [change.before, change.before, change.fitted[before], change.fitted[-1]]
        fitted["line"] = {"color": ORANGE, "width": 2}
    begin = band((change.begin_low, change.begin_high), (0.0, 1.0), yref="paper")
    axes = {
        "xaxis": axis("", type="date"),
        "yaxis": axis(f"{change.name}, {change.unit}", nticks=6),
    }
    words = f"{change.name} of each bag over time, and the change that was found"
    return Figure(anchor, 250, words, [dots, fitted], layout(axes, shapes=[begin]))
