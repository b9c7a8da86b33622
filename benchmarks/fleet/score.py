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
    quantities = [each for each in result.types[0].quantities if each.name in truth["type"]]
    for each in quantities:
        mean, sigma = truth["type"][each.name]
        inside = (
            each.mean_low <= mean <= each.mean_high,
            each.sigma_low <= sigma <= each.sigma_high,
        )
        right = [count + one for count, one in zip(right, inside, strict=True)]
        words = ["yes" if one else "no" for one in inside]
        said.append(
            f"| {each.name} | {each.unit} | {mean:g}, {sigma:g} | {each.mean:.4g}, "
            f"{each.mean_low:.4g} … {each.mean_high:.4g} | {each.sigma:.2g}, "
            f"{each.sigma_low:.2g} … {each.sigma_high:.2g} | {words[0]} | {words[1]} |"
        )
    said += ["", f"Of {len(quantities)} intervals of the mean {right[0]} cover, of σ {right[1]}."]
    return said


def _planted_lines(planted: Mapping[str, str], result: FleetResult) -> list[str]:
    called = {
        robot.robot: [each.name for each in robot.quantities if each.differs]
        for robot in result.robots
        if any(each.differs for each in robot.quantities)
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
        found = next((each for each in changes if each.name == drift.parameter), None)
        if found is None:
            said.append(f"| {drift.words} | {name} | {began:%Y-%m-%d} | **not found** | | |")
            continue
        off = (datetime.fromisoformat(found.begin.replace("Z", "+00:00")) - began) / CADENCE
        said.append(
            f"| {drift.words} | {name} | {began:%Y-%m-%d} | {found.kind}, {found.begin[:10]} | "
            f"{found.begin_low[:10]} … {found.begin_high[:10]} | {off:+.0f} |"
        )
    wrong = [r.robot for r in result.robots if r.changes and r.robot not in drifting]
    said += ["", f"Robots falsely said to have changed: {', '.join(wrong) or 'none'}."]
    return said


def _corrupt_line(corrupt: list[str], result: FleetResult) -> str:
    there = {bag.uri: bag for bag in result.bags}
    known = [name for name in corrupt if any(uri.endswith(name) for uri in there)]
    listed = [
        bag for uri, bag in there.items() if not bag.used and any(uri.endswith(c) for c in corrupt)
    ]
    others = [bag.uri for bag in result.bags if not bag.used and bag not in listed]
    return (
        f"Corrupt bags: {len(listed)} of {len(known)} are listed with a reason; "
        f"{len(others)} sound bags were not used."
    )
