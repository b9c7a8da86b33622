"""What is asked of the answers: a yes or no of each cell, for the page and for comparisons."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from benchmarks.hostile.judge import Answer

LEAST_RATIO = 1.0  # ρ from which on an effect is asked for; the calibration may miss by a tenth

Ask = Callable[[Answer], bool | None]


@dataclass(frozen=True)
class Figure:
    """A share of cells.

    Attributes
    ----------
    name : str
    target : str
        What the diagnosis is to reach; empty where nothing is asked.
    ask : Ask
        Yes or no of a cell; None where the question is not asked of it.
    """

    name: str
    target: str
    ask: Ask


def _of(group: str, ask: Ask, where: Callable[[Mapping[str, Any]], bool] = lambda _: True) -> Ask:
    return lambda cell: ask(cell) if cell.label["group"] == group and where(cell.label) else None


def asked(label: Mapping[str, Any]) -> bool:
    """Whether all effects of a cell stand out enough to be asked for."""
    return all(effect["rho"] >= 0.9 * LEAST_RATIO for effect in label["effects"])


def shown(label: Mapping[str, Any]) -> bool:
    """Whether all effects of a cell are asked for and stand out as much in its recordings."""
    there = [effect.get("rho_recorded") for effect in label["effects"]]
    return asked(label) and all(rho is not None and rho >= LEAST_RATIO for rho in there)


def _small(label: Mapping[str, Any]) -> bool:
    return bool(label["joints"] == 2)


def _false(cell: Answer) -> bool:
    return bool(cell.false_names)


def _hit(number: int = 0) -> Ask:
    return lambda cell: cell.ranked[number].hit


def form(cell: Answer) -> str:
    """Effect of a cell with one, in the form in which it was simulated."""
    effect = cell.label["effects"][0]
    return str(effect.get("form") or effect["effect"])


FIGURES = (
    Figure("false cause, nothing wrong", "≤ 3 %", _of("none", _false)),
    Figure("– every number off", "≤ 3 %", _of("none", _false, lambda label: label["numbers_off"])),
    Figure("– numbers right", "≤ 3 %", _of("none", _false, lambda label: not label["numbers_off"])),
    Figure(
        "one effect, 2 joints: hit",
        "≥ 92 %",
        _of("single", _hit(), lambda label: asked(label) and _small(label)),
    ),
    Figure(
        "one effect, 6 and 7 joints: hit",
        "≥ 90 %",
        _of("single", _hit(), lambda label: asked(label) and not _small(label)),
    ),
    Figure(
        "– of 2 joints, and ρ ≥ 1 in the recording too",
        "≥ 92 %",
        _of("single", _hit(), lambda label: shown(label) and _small(label)),
    ),
    Figure(
        "– of 6 and 7 joints, and ρ ≥ 1 in the recording too",
        "≥ 90 %",
        _of("single", _hit(), lambda label: shown(label) and not _small(label)),
    ),
    Figure(
        "– every number off",
        "≥ 90 %",
        _of("single", _hit(), lambda label: asked(label) and label["numbers_off"]),
    ),
    Figure(
        "– numbers right",
        "≥ 90 %",
        _of("single", _hit(), lambda label: asked(label) and not label["numbers_off"]),
    ),
    Figure("– anywhere in a set", "", _of("single", lambda cell: cell.ranked[0].anywhere, asked)),
    Figure("– and the first cause", "", _of("single", lambda cell: cell.ranked[0].first, asked)),
    Figure("one wrong number: hit", "", _of("parametric", _hit(), asked)),
    Figure("– and ρ ≥ 1 in the recording too", "", _of("parametric", _hit(), shown)),
    Figure(
        "pairs, both hit",
        "≥ 75 %",
        _of("pair", lambda cell: all(truth.hit for truth in cell.ranked), asked),
    ),
    Figure(
        "– and ρ ≥ 1 in the recording too",
        "≥ 75 %",
        _of("pair", lambda cell: all(truth.hit for truth in cell.ranked), shown),
    ),
    Figure("payload beside friction: payload hit", "≥ 90 %", _of("payload", _hit(0), asked)),
    Figure(
        "– its mass in the 95 % interval, where named",
        "≥ 90 %",
        _of("payload", lambda cell: cell.mass_in_interval),
    ),
    Figure(
        "– payload hit, and ρ ≥ 1 of both in the recording too",
        "≥ 90 %",
        _of("payload", _hit(0), shown),
    ),
    Figure("– friction hit", "≥ 90 %", _of("payload", _hit(1), asked)),
    Figure("outside the catalogue, misnamed", "≤ 5 %", _of("outside", _false)),
    Figure("cells with a false cause", "", _false),
    Figure("cells right: all found, nothing made up", "", lambda cell: cell.right),
)
