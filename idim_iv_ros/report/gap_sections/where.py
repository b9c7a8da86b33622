"""Joint × regime: which part of the motion holds the gap."""

import math
from collections.abc import Sequence

from idim_iv_ros.diagnosis.result import GapResult, Regime
from idim_iv_ros.report.gap_words import AXES, regime_range
from idim_iv_ros.report.markup import Html, section, tag
from idim_iv_ros.report.numerals import known, number, percent

_STRONGEST = 3.0  # of log2 of the lift; stronger ones have the same colour


def where_section(result: GapResult) -> Html | None:
    """Return a map for each axis, or None without regimes."""
    if not result.regimes:
        return None
    axes = list(dict.fromkeys([*AXES, *(each.axis for each in result.regimes)]))
    maps = [_map(result, axis) for axis in axes]
    return section(
        "In which regime",
        "where",
        tag(
            "p",
            "Each cell: share of the joint's gap energy in that part of the motion. Its colour "
            "compares the share with that of the samples: orange where the gap is denser than "
            "the samples (lift above 1), blue where it is thinner; parts in which the two differ "
            "by no more than chance are left out. The pointer on a cell shows both, with the "
            "interval of the lift.",
            css="explanation",
        ),
        tag("div", [each for each in maps if each is not None], css="maps"),
    )


def _map(result: GapResult, axis: str) -> Html | None:
    by_joint = {
        joint: sorted(
            (each for each in result.regimes if each.joint == joint and each.axis == axis),
            key=lambda each: each.low,
        )
        for joint in result.joints
    }
    by_joint = {joint: regimes for joint, regimes in by_joint.items() if regimes}
    if not by_joint:
        return None
    bounds = sorted({(each.low, each.high) for row in by_joint.values() for each in row})
    columns = max(len(regimes) for regimes in by_joint.values())
    units = {joint: regimes[0].unit for joint, regimes in by_joint.items()}
    one = next(iter(units.values())) if len(set(units.values())) == 1 else None
    same = len(bounds) == columns and one is not None
    title = f"{AXES.get(axis, axis)}, {one}" if one else AXES.get(axis, axis)
    longest = max(by_joint.values(), key=len)
    heads = [regime_range(regime, result.session) for regime in longest] if same else []
    head = [tag("th", "", scope="col"), *(tag("th", text, scope="col") for text in heads)]
    rows = [
        tag(
            "tr",
            tag("th", joint if one is not None else f"{joint}, {units[joint]}", scope="row"),
            _cells(result, _placed(regimes, bounds) if same else regimes, columns, same),
        )
        for joint, regimes in by_joint.items()
    ]
    table = tag(
        "table",
        tag("caption", title),
        tag("thead", tag("tr", head)) if same else None,
        tag("tbody", rows),
        css="map",
    )
    return tag("div", table, css="wide")


def _placed(
    regimes: Sequence[Regime], bounds: Sequence[tuple[float, float]]
) -> list[Regime | None]:
    """Regimes at the columns of their bounds; None where a joint has no samples."""
    by_bounds = {(each.low, each.high): each for each in regimes}
    return [by_bounds.get(each) for each in bounds]


def _cells(
    result: GapResult, regimes: Sequence[Regime | None], columns: int, same: bool
) -> list[Html]:
    cells = [_cell(result, regime, same) for regime in regimes]
    return [*cells, *(_cell(result, None, same) for _ in range(columns - len(regimes)))]


def _cell(result: GapResult, regime: Regime | None, same: bool) -> Html:
    if regime is None:
        return tag("td", "–", css="quiet")
    return tag(
        "td",
        percent(100.0 * regime.energy_share),
        None if same else tag("small", regime_range(regime, result.session)),
        style=f"background:{_colour(regime.lift)}",
        title=_hover(result, regime),
    )


def _colour(lift: float) -> str:
    if not known(lift):
        return "transparent"
    strength = math.log2(max(lift, 2.0**-_STRONGEST))
    alpha = min(abs(strength) / _STRONGEST, 1.0)
    return f"rgba({'213,94,0' if strength > 0.0 else '0,114,178'},{0.75 * alpha:.2f})"


def _hover(result: GapResult, regime: Regime) -> str:
    interval = ""
    if regime.ci95 is not None and known(regime.ci95[0]) and known(regime.ci95[1]):
        interval = f" ({number(regime.ci95[0], 2)} to {number(regime.ci95[1], 2)})"
    bounds = regime_range(regime, result.session)
    if not (regime.axis == "time" and len(result.session) > 1):
        bounds = f"{bounds} {regime.unit}".strip()
    return (
        f"{regime.joint}, {bounds}: {percent(100.0 * regime.energy_share)} of the gap in "
        f"{percent(100.0 * regime.occupancy)} of the samples, lift "
        f"{number(regime.lift, 2)}{interval}"
    )
