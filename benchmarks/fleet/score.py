"""What `idim-iv fleet` said of the simulated fleet, beside what was simulated."""

import json
from collections.abc import Mapping
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from benchmarks.fleet.arms import Drifting
from benchmarks.fleet.make import START
from idim_iv_ros.fleet.result import FleetResult

CADENCE = timedelta(days=7)  # of the bags of a robot


def score(fleet: Path, result: FleetResult) -> list[str]:
    """Lines of the results page.

    Parameters
    ----------
    fleet
        Folder of the simulated fleet.
    result
        What was said of its bags, or of a part of them.
    """
    truth = json.loads((fleet / "truth.json").read_text(encoding="utf-8"))
    planted = {r["name"]: r["planted"]["words"] for r in truth["robots"] if r["planted"]}
    drifting = {r["name"]: r["drifting"] for r in truth["robots"] if r["drifting"]}
    return [
        *_type_lines(truth, result),
        "",
        *_planted_lines(planted, result),
        "",
        *_drift_lines(drifting, truth["bags"], result),
        "",
        _corrupt_line(truth["corrupt"], result),
    ]


def _type_lines(truth: Mapping[str, Any], result: FleetResult) -> list[str]:
    """Mean and scatter of the type, beside those that the robots were drawn from."""
    said = [
        "| parameter | unit | drawn from: mean, σ | mean, 95 % | σ, 95 % | mean in | σ in |",
        "|---|---|---|---|---|---|---|",
    ]
    right = [0, 0]
    quantities = [
        quantity for quantity in result.types[0].quantities if quantity.name in truth["type"]
    ]
    for quantity in quantities:
        mean, sigma = truth["type"][quantity.name]
        inside = (
            quantity.mean_low <= mean <= quantity.mean_high,
            quantity.sigma_low <= sigma <= quantity.sigma_high,
        )
        right = [count + one for count, one in zip(right, inside, strict=True)]
        words = ["yes" if one else "no" for one in inside]
        said.append(
            f"| {quantity.name} | {quantity.unit} | {mean:g}, {sigma:g} | {quantity.mean:.4g}, "
            f"{quantity.mean_low:.4g} … {quantity.mean_high:.4g} | {quantity.sigma:.2g}, "
            f"{quantity.sigma_low:.2g} … {quantity.sigma_high:.2g} | {words[0]} | {words[1]} |"
        )
    said += ["", f"Of {len(quantities)} intervals of the mean {right[0]} cover, of σ {right[1]}."]
    return said


def _planted_lines(planted: Mapping[str, str], result: FleetResult) -> list[str]:
    called = {
        robot.robot: [quantity.name for quantity in robot.quantities if quantity.differs]
        for robot in result.robots
        if any(quantity.differs for quantity in robot.quantities)
    }
    said = ["| planted | robot | found in |", "|---|---|---|"]
    said += [
        f"| {words} | {name} | {', '.join(called[name]) if name in called else '**not found**'} |"
        for name, words in planted.items()
    ]
    wrong = {name: names for name, names in called.items() if name not in planted}
    listed = "; ".join(f"{name} in {', '.join(names)}" for name, names in wrong.items())
    share = 100.0 * len(wrong) / max(len(called), 1)
    said += [
        "",
        f"{len(called)} robots called different, {len(wrong)} of them falsely ({share:.0f} %)"
        f"{': ' + listed if listed else ''}; {len(set(planted) & set(called))} of {len(planted)} "
        "planted ones found.",
    ]
    return said


def _drift_lines(
    drifting: Mapping[str, Mapping[str, Any]], bags: int, result: FleetResult
) -> list[str]:
    said = ["| drift | robot | began | found | interval | bags off |", "|---|---|---|---|---|---|"]
    for name, values in drifting.items():
        drift = Drifting(**values)
        began = START + CADENCE * drift.begin(bags)
        changes = [c for r in result.robots if r.robot == name for c in r.changes]
        change = next((change for change in changes if change.name == drift.parameter), None)
        if change is None:
            said.append(f"| {drift.words} | {name} | {began:%Y-%m-%d} | **not found** | | |")
            continue
        off = (datetime.fromisoformat(change.begin.replace("Z", "+00:00")) - began) / CADENCE
        said.append(
            f"| {drift.words} | {name} | {began:%Y-%m-%d} | {change.kind}, {change.begin[:10]} | "
            f"{change.begin_low[:10]} … {change.begin_high[:10]} | {off:+.0f} |"
        )
    wrong = [r.robot for r in result.robots if r.changes and r.robot not in drifting]
    said += ["", f"Robots falsely said to have changed: {', '.join(wrong) or 'none'}."]
    return said


def _corrupt_line(corrupt: list[str], result: FleetResult) -> str:
    there = {bag.uri: bag for bag in result.bags}
    present = [name for name in corrupt if any(uri.endswith(name) for uri in there)]
    listed = [
        bag for uri, bag in there.items() if not bag.used and any(uri.endswith(c) for c in corrupt)
    ]
    others = [bag.uri for bag in result.bags if not bag.used and bag not in listed]
    return (
        f"Corrupt bags: {len(listed)} of {len(present)} are listed with a reason; "
        f"{len(others)} sound bags were not used."
    )
