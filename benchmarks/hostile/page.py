"""The page of the hostile benchmark: figures against targets, then one row a cell."""

from collections.abc import Iterable, Sequence
from math import sqrt
from statistics import mean, median, stdev

from benchmarks.hostile.judge import Answer
from benchmarks.withheld_effects.tables import NORMAL_975, share

LEAST_RATIO = 0.6
CLEAR = 0.9 * LEAST_RATIO  # the calibration may miss by a tenth


def page_lines(answers: dict[str, Answer], missing: dict[str, str]) -> list[str]:
    """Return the page as Markdown lines; `missing` are cells without an answer, with the reason."""
    cells = list(answers.values())
    apart = sum(bool(cell.unanswerable) for cell in cells)
    return [
        f"{len(cells)} cells judged, {len(missing)} without an answer. In {apart} of them the "
        "control law differs and the configuration knows none: it is not asked for.",
        "",
        *_figures(cells),
        "",
        *_rows(answers),
        *(f"\n{name}: no answer ({reason})" for name, reason in missing.items()),
    ]


def average(values: Sequence[float]) -> str:
    """`0.12 ± 0.05 (34)`: mean with the half-width of its 95 % interval, and the count."""
    if not values:
        return "—"
    half = NORMAL_975 * stdev(values) / sqrt(len(values)) if len(values) > 1 else float("nan")
    return f"{mean(values):.2f} ± {half:.2f} ({len(values)})"


def _figures(cells: list[Answer]) -> list[str]:
    none = _of(cells, "none")
    single = [cell for cell in _of(cells, "single", "parametric") if _clear(cell)]
    small = [cell for cell in single if _small(cell)]
    large = [cell for cell in single if not _small(cell)]
    payload, outside = _of(cells, "payload"), _of(cells, "outside")
    asked = [cell for cell in _of(cells, "single", "pair", "payload", "parametric") if cell.sets]
    named = [cell for cell in payload if cell.found[0]]
    rows = [
        ("false cause on none", share(bool(cell.false_names) for cell in none), "≤ 5 %"),
        ("right effect and joint, 2 joints", share(cell.first for cell in small), "≥ 90 %"),
        ("right effect and joint, 6 and 7 joints", share(cell.first for cell in large), "≥ 85 %"),
        (
            "false extra causes, one effect",
            average([len(cell.false_names) for cell in _of(cells, "single", "parametric")]),
            "≤ 0.1",
        ),
        ("truth in the set", share(right for cell in asked for right in cell.covering), "≥ 95 %"),
        ("size of the set", average([size for cell in asked for size in cell.sets]), "≤ 1.7"),
        ("payload beside friction named", share(cell.found[0] for cell in payload), "≥ 90 %"),
        (
            "its mass within its 95 % interval",
            share(cell.mass_in_interval is True for cell in named),
            "≥ 90 %",
        ),
        ("friction beside the payload named", share(cell.found[1] for cell in payload), ""),
        ("two effects, each found", share(f for c in _of(cells, "pair") for f in c.found), ""),
        ("outside the catalogue, misnamed", share(bool(c.false_names) for c in outside), "≤ 10 %"),
        ("processor seconds, 2 joints", _seconds(filter(_small, cells)), ""),
        (
            "processor seconds, 6 and 7 joints",
            _seconds(cell for cell in cells if not _small(cell)),
            "",
        ),
        ("the same for 60 s of 6 joints, by proportion", _proportional(cells), "≤ 20"),
    ]
    return ["| figure | measured | target |", "|---|---|---|"] + [
        f"| {name} | {value} | {target} |" for name, value, target in rows
    ]


def _rows(answers: dict[str, Answer]) -> list[str]:
    lines = [
        "| cell | group | robot | what is there (ρ) | what was said | | s |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, cell in sorted(answers.items(), key=lambda item: (item[1].label["group"], item[0])):
        label = cell.label
        there = ", ".join(
            f"{each['effect']}[{each['joint']}] ({each['rho']:.1f})" for each in label["effects"]
        )
        said = "; ".join(each.replace("|", "\\|") for each in cell.said) or f"({cell.verdict})"
        robot = label["robot"] + (", MuJoCo" if label["plant"] == "mujoco" else "")
        lines.append(
            f"| {name} | {label['group']} | {robot} | {there or '–'} | {said} | {cell.outcome} | "
            f"{cell.seconds:.0f} |"
        )
    return lines


def _of(cells: Iterable[Answer], *groups: str) -> list[Answer]:
    return [cell for cell in cells if cell.label["group"] in groups]


def _small(cell: Answer) -> bool:
    return bool(cell.label["robot"] == "arm2")


def _clear(cell: Answer) -> bool:
    """The effect can be named, and stands out enough to be asked for."""
    return bool(cell.found) and bool(cell.label["effects"][0]["rho"] >= CLEAR)


def _seconds(cells: Iterable[Answer]) -> str:
    values = [cell.seconds for cell in cells]
    return f"median {median(values):.0f}, at most {max(values):.0f}" if values else "—"


def _proportional(cells: Iterable[Answer]) -> str:
    values = [
        cell.seconds * 60.0 / sum(cell.label["seconds"])
        for cell in cells
        if cell.label["robot"] == "arm6"
    ]
    return f"median {median(values):.0f}, at most {max(values):.0f}" if values else "—"
