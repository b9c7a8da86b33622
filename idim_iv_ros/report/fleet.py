"""The page of a fleet: what needs attention, what the robots of a type share, what changed."""

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from idim_iv_ros.errors import first_of
from idim_iv_ros.fleet.result import (
    FleetResult,
    FleetRobot,
    FleetType,
    ParameterChange,
    TypeQuantity,
)
from idim_iv_ros.fleet.source import is_local, local_path
from idim_iv_ros.report.advice import Step
from idim_iv_ros.report.figures import BLUE, GREY, ORANGE, Figure, axis, band, scatter
from idim_iv_ros.report.numerals import INTERVAL, THIN, number, plural, with_unit
from idim_iv_ros.report.page import one_section, page_html
from idim_iv_ros.report.section import UNPLACED, Files

_BADGES = {
    "differs": ("bad", "▲", "differs"),
    "changed": ("bad", "↗", "changed"),
    "unsteady": ("fair", "≈", "unsteady"),
    "recordings": ("open", "?", "recordings"),
    "none": ("good", "✓", "ordinary"),
}
# What is said where nothing stands out: whether robots were compared, and followed over time.
_FEW_ROBOTS = "There are too few robots of each type to say whether one differs"
_NOTHING = {
    (True, True): "No robot differs from its type, and none changed over time, beyond chance.",
    (True, False): "No robot differs from its type beyond chance; whether one changed over time "
    "is not judged: too few bags at different times.",
    (False, True): f"{_FEW_ROBOTS}; none changed over time, beyond chance.",
    (False, False): f"{_FEW_ROBOTS}, and too few bags at different times to say whether one "
    "changed.",
}
_SECTIONS = {
    "attention": "What needs attention",
    "types": "Parameters of each type",
    "changes": "Changes over time",
    "diagnoses": "What to diagnose",
    "bags": "Bags that were not used",
    "limits": "What the numbers mean",
}
_HOVER = "%{text}<extra></extra>"
_MOST_BAGS = 3  # of a robot in a command
_MOST_NAMES = 6  # of robots in a sentence
_ROW = 26  # pixels of one quantity
_FARTHEST = 12.0  # deviations; what is farther is drawn there
_SCATTER = 0.28  # of a row, so that dots do not cover each other


def fleet_html(
    result: FleetResult, reports: Mapping[str, str] | None = None, files: Files = UNPLACED
) -> str:
    """Return the report of a fleet as one self-contained HTML document.

    `reports` has the address of each robot's own report, relative to the page, by the name of the
    robot; the recordings of `files` are the source of the fleet.
    """
    headlines, badge = [headline(result)], _badge(result)
    share = f"{100.0 * result.false_discoveries:g}{THIN}%"
    if badge[0] == "bad":
        first = result.robots[0]
        headlines.append(f"{first.robot}: {first.reasons[0].rstrip('.')}.")
        headlines.append(f"At most {share} of such robots are by chance.")
    shown = {
        "result": result,
        "share": share,
        "badge": badge,
        "badges": _BADGES,
        "headlines": headlines,
        "steps": steps(result, reports or {}, files),
        "reports": reports or {},
        "names_of": _names_of,
        "type_figure": partial(_distribution_figure, result),
        "changes": [(robot.robot, change) for robot in result.robots for change in robot.changes],
        "change_figure": _change_figure,
        "changes_judged": _testable(result)[1],
    }
    counts = f"{plural(len(result.robots), 'robot')}, {plural(len(result.bags), 'bag')}"
    sections = [
        one_section(f"fleet_{anchor}.html.j2", anchor, title, **shown)
        for anchor, title in _SECTIONS.items()
    ]
    return page_html("Fleet", counts, _subtitle(result), sections)


def _subtitle(result: FleetResult) -> str:
    seconds = sum(bag.duration for bag in result.bags if bag.used and math.isfinite(bag.duration))
    times = sorted(bag.time for bag in result.bags if bag.used and bag.time)
    span = f", recorded {times[0][:10]} to {times[-1][:10]}" if times else ""
    length = with_unit(seconds / 3600.0, "h") if seconds >= 3600.0 else with_unit(seconds, "s")
    return f"{plural(len(result.types), 'type')} of robots, {length} of recording{span}"


def _badge(result: FleetResult) -> tuple[str, str, str]:
    """Return the badge of the headline; it is good only if everything could be judged."""
    if any(robot.differs for robot in result.robots):
        return "bad", "▲", "a robot differs"
    if any(robot.changes for robot in result.robots):
        return "bad", "↗", "a robot changed"
    if all(_testable(result)):
        return "good", "✓", "nothing stands out"
    return "open", "?", "not all could be judged"


def _testable(result: FleetResult) -> tuple[bool, bool]:
    """Return whether robots could be compared with each other, and followed over time."""
    robots = [robot for robot in result.robots if robot.quantities]
    compared = any(math.isfinite(robot.p_value) for robot in robots)
    return compared, any(math.isfinite(robot.change_p_value) for robot in robots)


def steps(result: FleetResult, reports: Mapping[str, str], files: Files) -> list[Step]:
    """Return the next step: look at the first robot that stands out, or record again."""
    source, out = (*files.bags, "FOLDER")[0], files.folder or "fleet"
    if not any(bag.used for bag in result.bags):
        bags = [bag.uri for bag in result.bags[:1]]
        return [Step("See why the first bag cannot be used:", files.command("check", *bags))]
    first = result.robots[0]
    if first.attention in ("recordings", "none"):
        line = files.command("fleet", "identify", source, out=out)
        return [Step("Record the robots again, a bag each, and compare anew:", line)]
    contrast = _contrast_steps(result, first, files) if reports else []
    repeat = files.command("fleet", "diagnose", source, out=out)
    return contrast or [Step("Find out why they stand out:", repeat)]


def _contrast_steps(result: FleetResult, robot: FleetRobot, files: Files) -> list[Step]:
    """Return a step that compares a robot with itself before a change, or an ordinary robot.

    Empty where the bags are not on this machine.
    """
    screened = [s for s in result.screen if s.robot == robot.robot or s.why == "typical"]
    after = [uri for s in screened if s.robot == robot.robot for uri in s.bags]
    ordinary = [s for s in screened if s.type == robot.type and s.robot != robot.robot][:1]
    before = [uri for s in ordinary for uri in s.bags]
    if robot.attention == "changed":
        ordinary, begin = [], min(change.begin for change in robot.changes)
        dated = sorted((bag.time, bag.uri) for bag in result.bags
                       if bag.used and bag.time and bag.robot == robot.robot)  # fmt: skip
        before = [uri for time, uri in dated if time < begin][-_MOST_BAGS:]
        after = [uri for time, uri in dated if time >= begin][-_MOST_BAGS:]
    if not (before and after and all(map(is_local, (*before, *after)))):
        return []
    first, second = ([_short(local_path(uri)) for uri in uris] for uris in (before, after))
    line = files.command("diagnose", *first, "--against", *second, out="changed")
    other = f"{ordinary[0].robot}, an ordinary robot" if ordinary else "what it was"
    return [Step(f"See in what {robot.robot} differs from {other}:", line)]


def _short(path: Path) -> str:
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def headline(result: FleetResult) -> str:
    """Return one sentence on the fleet: robots that differ or changed."""
    differs = [robot.robot for robot in result.robots if robot.differs]
    changed = [robot.robot for robot in result.robots if robot.changes]
    counted = [robot for robot in result.robots if robot.quantities]
    if not counted:
        return "No bag of this fleet could be used."
    parts = []
    if differs:
        verb = "differs" if len(differs) == 1 else "differ"
        names = first_of(differs, _MOST_NAMES)
        parts.append(f"{plural(len(differs), 'robot')} {verb} from the type ({names})")
    if changed:
        names = first_of(changed, _MOST_NAMES)
        parts.append(f"{plural(len(changed), 'robot')} changed over time ({names})")
    if not parts:
        return _NOTHING[_testable(result)]
    return f"{'; '.join(parts)}."


def _names_of(robot: FleetRobot) -> tuple[str, ...]:
    """Return names that keep their case at the start of a sentence: robot and parameters."""
    names = (quantity.name for quantity in robot.quantities)
    return (robot.robot, *(name for name in names if not name.startswith("residual")))


def _distribution_figure(result: FleetResult, kind: FleetType) -> Figure | None:
    """Return robots as dots, a row a quantity, in deviations from the mean of the type.

    None where no quantity has a mean and a scatter.
    """
    robots = [robot for robot in result.robots if robot.type == kind.type and robot.quantities]
    rows = []
    for column, quantity in enumerate(kind.quantities):
        estimates = [robot.quantities[column] for robot in robots]
        ordinary = [estimate.value for estimate in estimates if not estimate.differs]
        distances = np.array([_deviations(quantity, 1.0, value) for value in ordinary])
        finite = distances[np.isfinite(distances)]
        unit = float(np.sqrt(np.mean(finite**2))) if len(finite) > 1 else 0.0
        if math.isfinite(quantity.mean) and unit > 0.0:
            rows.append((quantity, unit, estimates))
    if not rows:
        return None
    shapes: list[dict[str, Any]] = []
    marks: dict[bool, list[tuple[float, float, str]]] = {False: [], True: []}
    for row, (quantity, unit, estimates) in enumerate(rows):
        height = float(len(rows) - 1 - row)
        shapes += _row_shapes(quantity, unit, height)
        for number_of, (robot, estimate) in enumerate(zip(robots, estimates, strict=True)):
            distance = _deviations(quantity, unit, estimate.value)
            if not math.isfinite(distance):
                continue
            # Golden ratio: neighbours in the list lie far from each other.
            shift = _SCATTER * (2.0 * ((number_of * 0.6180339887) % 1.0) - 1.0)
            words = f"{robot.robot}: {quantity.name} {number(estimate.value, 4)} {quantity.unit}"
            side = max(-_FARTHEST, min(_FARTHEST, distance))
            marks[estimate.differs].append((round(side, 3), round(height + shift, 3), words))
    data = []
    for differs, colour, size, opacity in ((False, BLUE, 5, 0.55), (True, ORANGE, 8, 1.0)):
        x, y, text = ([mark[k] for mark in marks[differs]] for k in range(3))
        marker = {"color": colour, "size": size, "opacity": opacity, "symbol": "diamond"}
        data.append(scatter(x, y, "markers", marker=marker, text=text, hovertemplate=_HOVER))
    names = [quantity.name for quantity, *_ in rows]
    axes = {
        "xaxis": axis("Distance from the mean of the type, standard deviations of its robots",
                      range=[-_FARTHEST - 0.5, _FARTHEST + 0.5], dtick=2),
        "yaxis": axis("", tickvals=list(range(len(names))), ticktext=names[::-1],
                      range=[-0.6, len(names) - 0.4], showgrid=False),
    }  # fmt: skip
    anchor = f"distribution-{result.types.index(kind)}"
    words = f"Robots of type {kind.type} beside each other, one row for each quantity"
    layout = {**axes, "shapes": shapes, "margin": {"l": 90, "r": 12, "t": 8, "b": 44}}
    return Figure(anchor, 70 + _ROW * len(names), words, data, layout)


def _row_shapes(quantity: TypeQuantity, unit: float, height: float) -> list[dict[str, Any]]:
    """Return plotly shapes of the intervals of next robot and mean, at a height."""
    intervals = (quantity.next_low, quantity.next_high), (quantity.mean_low, quantity.mean_high)
    following, mean = ([_deviations(quantity, unit, end) for end in ends] for ends in intervals)
    shapes = []
    if all(map(math.isfinite, following)):
        shapes.append(band(_inside(following), (height - 0.36, height + 0.36)))
    line = {"color": GREY, "width": 5}
    return [*shapes, band(_inside(mean), (height, height), type="line", line=line)]


def _inside(ends: list[float]) -> tuple[float, float]:
    return max(ends[0], -_FARTHEST), min(ends[1], _FARTHEST)


def _deviations(quantity: TypeQuantity, unit: float, value: float) -> float:
    if quantity.kind == "residual":
        return math.log(value / quantity.mean) / unit if value > 0.0 else math.nan
    return (value - quantity.mean) / unit


def _change_figure(change: ParameterChange, anchor: str) -> Figure:
    times, values, fitted = list(change.times), list(change.values), list(change.fitted)
    bars = {"type": "data", "array": [INTERVAL * std for std in change.stds], "color": BLUE}
    dots: dict[str, Any] = {
        "error_y": {**bars, "thickness": 1, "width": 0},
        "marker": {"color": BLUE, "size": 7, "symbol": "diamond"},
        "hovertemplate": f"%{{y:.4g}} {change.unit}, %{{x|%Y-%m-%d %H:%M}}<extra></extra>",
    }
    bags = scatter(times, values, "markers", **dots)
    if change.kind == "step":
        # The level holds up to the first bag that is changed.
        before = int(np.searchsorted(times, change.begin))
        times = [times[0], change.begin, change.begin, times[-1]]
        fitted = [change.before, change.before, change.fitted[before], change.fitted[-1]]
    style = {"line": {"color": ORANGE, "width": 2}, "hoverinfo": "skip"}
    law = scatter(times, fitted, "lines", **style)
    begin = band((change.begin_low, change.begin_high), (0.0, 1.0), yref="paper")
    axes = {
        "xaxis": axis("", type="date"),
        "yaxis": axis(f"{change.name}, {change.unit}", nticks=6),
    }
    words = f"{change.name} of each bag over time, and the change that was found"
    return Figure(anchor, 250, words, [bags, law], {**axes, "shapes": [begin]})
