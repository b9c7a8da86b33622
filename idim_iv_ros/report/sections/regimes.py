"""Joint × regime: which part of the motion holds the gap."""

import math
from collections.abc import Sequence
from typing import Any

from idim_iv_ros.diagnosis.result import GapResult, Regime
from idim_iv_ros.report.gap_words import AXES, regime_range
from idim_iv_ros.report.numerals import known, number, percent
from idim_iv_ros.report.section import Report, Section

_STRONGEST = 3.0  # of log2 of the lift; stronger ones have the same colour


def _context(report: Report[GapResult]) -> dict[str, Any] | None:
    result = report.result
    if not result.regimes:
        return None
    axes = list(dict.fromkeys([*AXES, *(regime.axis for regime in result.regimes)]))
    maps = [_map(result, axis) for axis in axes]
    return {"maps": [drawing for drawing in maps if drawing is not None]}


def _map(result: GapResult, axis: str) -> dict[str, Any] | None:
    of_axis = sorted(
        (regime for regime in result.regimes if regime.axis == axis), key=lambda x: x.low
    )
    by_joint = {
        joint: regimes
        for joint in result.joints
        if (regimes := [each for each in of_axis if each.joint == joint])
    }
    if not by_joint:
        return None
    bounds = sorted({(cell.low, cell.high) for row in by_joint.values() for cell in row})
    longest = max(by_joint.values(), key=len)
    units = {joint: regimes[0].unit for joint, regimes in by_joint.items()}
    one = next(iter(units.values())) if len(set(units.values())) == 1 else None
    same = len(bounds) == len(longest) and one is not None
    rows = []
    for joint, regimes in by_joint.items():
        placed: list[Regime | None] = list(_placed(regimes, bounds) if same else regimes)
        placed += [None] * (len(longest) - len(placed))
        name = joint if one is not None else f"{joint}, {units[joint]}"
        rows.append((name, [_cell(result, regime, same) for regime in placed]))
    title = AXES.get(axis, axis)
    return {
        "title": f"{title}, {one}" if one else title,
        "heads": [regime_range(each, result.session) for each in longest] if same else [],
        "rows": rows,
    }


def _placed(
    regimes: Sequence[Regime], bounds: Sequence[tuple[float, float]]
) -> list[Regime | None]:
    """Regimes at the columns of their bounds; None where a joint has no samples."""
    by_bounds = {(regime.low, regime.high): regime for regime in regimes}
    return [by_bounds.get(bound) for bound in bounds]


def _cell(result: GapResult, regime: Regime | None, same: bool) -> dict[str, Any] | None:
    """Share, range where the head does not say it, CSS class and strength, words."""
    if regime is None:
        return None
    strength = 0.0
    if known(regime.lift):
        strength = math.log2(max(regime.lift, 2.0**-_STRONGEST))
    return {
        "share": percent(100.0 * regime.energy_share),
        "range": "" if same else regime_range(regime, result.session),
        "css": "denser" if strength > 0.0 else "thinner",
        "strength": round(75.0 * min(abs(strength) / _STRONGEST, 1.0)),
        "words": _words(result, regime),
    }


def _words(result: GapResult, regime: Regime) -> str:
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


REGIMES = Section(
    "Regimes",
    "where",
    "regimes.html.j2",
    _context,
    "at which speeds, positions, loads and times the gap lies",
)
