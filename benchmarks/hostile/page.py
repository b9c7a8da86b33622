"""The page of the hostile benchmark: figures against targets, effects, seconds and memory."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from math import nan, sqrt
from statistics import mean, median, stdev

from benchmarks.hostile.figures import FIGURES, Ask, asked, form
from benchmarks.hostile.judge import Answer
from benchmarks.withheld_effects.tables import NORMAL_975, share

CLAIMED = 0.9  # probability from which on a claim is asked to be true nine times of ten
MOST_MEMORY = 700.0  # MB


def page_lines(answers: dict[str, Answer], missing: dict[str, str]) -> list[str]:
    """Return the page as Markdown lines; `missing` are cells without an answer, with the reason."""
    cells = list(answers.values())
    groups = Counter(cell.label["group"] for cell in cells)
    return [
        f"{len(cells)} cells judged, {len(missing)} without an answer: "
        + ", ".join(f"{count} {group}" for group, count in sorted(groups.items()))
        + ". Intervals are Wilson's, 95 %.",
        "",
        *_figures(cells),
        "",
        *_by_effect(cells),
        *(f"\n{name}: no answer ({reason})" for name, reason in missing.items()),
    ]


def cell_rows(answers: dict[str, Answer]) -> list[dict[str, object]]:
    """What is there and what was said, cell by cell, for the file beside the page."""
    return [
        {
            "cell": name,
            "group": cell.label["group"],
            "robot": cell.label["robot"],
            "plant": cell.label["plant"],
            "numbers_off": cell.label["numbers_off"],
            "there": [
                f"{effect.get('form') or effect['effect']}[{effect['joint']}] {effect['rho']:.1f}"
                for effect in cell.label["effects"]
            ],
            "said": list(cell.said),
            "verdict": cell.verdict,
            "outcome": cell.outcome,
            "seconds": round(cell.seconds, 1),
        }
        for name, cell in sorted(answers.items())
    ]


def average(values: Sequence[float]) -> str:
    """`0.12 ± 0.05 (34)`: mean with the half-width of its 95 % interval, and the count."""
    if not values:
        return "—"
    half = NORMAL_975 * stdev(values) / sqrt(len(values)) if len(values) > 1 else nan
    return f"{mean(values):.2f} ± {half:.2f} ({len(values)})"


def answered(cells: Iterable[Answer], ask: Ask) -> list[bool]:
    """The yes or no of every cell that is asked."""
    return [said for cell in cells if (said := ask(cell)) is not None]


def _figures(cells: list[Answer]) -> list[str]:
    rows = [(figure.name, share(answered(cells, figure.ask)), figure.target) for figure in FIGURES]
    claims = [true for cell in cells for p, true in cell.claims if p is not None and p >= CLAIMED]
    sets = [float(size) for cell in cells for size in cell.sets]
    rows += [
        ("false causes a recording", average([len(c.false_names) for c in cells]), "≤ 0.05"),
        ("size of a set", average(sets), ""),
        (f"said with {100 * CLAIMED:.0f} % or more, and true", share(claims), "≥ 90 %"),
    ]
    for words, two in (("2 joints", True), ("6 and 7 joints", False)):
        some = [cell for cell in cells if (cell.label["joints"] == 2) == two]
        rows.append((f"processor seconds, {words}", _spread([c.seconds for c in some]), ""))
    peaks = [cell.peak for cell in cells]
    rows.append((f"above {MOST_MEMORY:.0f} MB", share(p > MOST_MEMORY for p in peaks), "none"))
    rows.append(("MB", _spread(peaks), "≤ 700"))
    return ["| figure | measured | target |", "|---|---|---|"] + [
        f"| {name} | {value} | {target} |" for name, value, target in rows
    ]


def _by_effect(cells: Iterable[Answer]) -> list[str]:
    groups: dict[str, list[Answer]] = defaultdict(list)
    for cell in cells:
        if cell.label["group"] in ("single", "parametric") and asked(cell.label):
            groups[form(cell)].append(cell)
    lines = [
        "| effect alone | hit | anywhere | false causes beside it | said instead |",
        "|---|---|---|---|---|",
    ]
    for name, some in sorted(groups.items()):
        first = [name.split(" | ")[0].split("[")[0] for cell in some for name in cell.false_names]
        wrong = Counter(first)
        lines.append(
            f"| {name} | {share(cell.ranked[0].hit for cell in some)} "
            f"| {sum(cell.ranked[0].anywhere for cell in some)} "
            f"| {sum(len(cell.false_names) for cell in some)} "
            f"| {', '.join(f'{effect} {count}' for effect, count in wrong.most_common(3))} |"
        )
    return lines


def _spread(values: Sequence[float]) -> str:
    return f"median {median(values):.0f}, at most {max(values):.0f}" if values else "—"
