"""The tables of the blind benchmark, every share with its count and Wilson interval."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from statistics import mean, median

from statsmodels.stats.proportion import proportion_confint

from benchmarks.withheld_effects.cells import RATIOS
from benchmarks.withheld_effects.verdict import CellScore, Scored

NORMAL_975 = 1.959964


def share(hits: Iterable[bool]) -> str:
    """`91.2 % (31/34; 77–97 %)`, or a dash."""
    values = list(hits)
    if not values:
        return "—"
    low, high = proportion_confint(sum(values), len(values), method="wilson")
    return (
        f"{100 * sum(values) / len(values):.1f} % "
        f"({sum(values)}/{len(values)}; {100 * low:.0f}–{100 * high:.0f} %)"
    )


def pair_f1(pairs: Sequence[CellScore]) -> float | None:
    """F1 over all true effects and accepted causes of the pairs; None without pairs."""
    hits = sum(sum(cell.named) for cell in pairs)
    missed = sum(len(cell.named) - sum(cell.named) for cell in pairs)
    made_up = sum(len(cell.false_alarms) for cell in pairs)
    return 2 * hits / (2 * hits + missed + made_up) if pairs else None


def page_lines(scored: Scored) -> list[str]:
    """The page as Markdown lines: figures against targets, breakdown, failures."""
    cells = list(scored.cells.values())
    return [
        f"{len(cells)} cells judged, {len(scored.missing)} without a verdict.",
        "",
        *_figures(cells),
        "",
        *_breakdown(cells),
        "",
        *_failures(scored),
    ]


def _figures(cells: list[CellScore]) -> list[str]:
    of = {name: [cell for cell in cells if cell.label["group"] == name] for name in _groups(cells)}
    single = [cell for cell in of.get("single", []) if _clear(cell)]
    none = [cell for cell in of.get("none", []) if not cell.label["altered"]]
    altered = [cell for cell in of.get("none", []) if cell.label["altered"]]
    outside = [cell for cell in of.get("outside", []) if cell.label["effects"][0]["reached"]]
    named = [cell for cell in single if cell.set_size]
    shrunk = [cell.shrinkage for cell in single if cell.shrinkage is not None]
    f1 = pair_f1(of.get("pair", []))
    six = [cell.seconds for cell in cells if cell.label["robot"] == "arm6"]
    poor = [cell for cell in of.get("poor", []) if cell.label["effects"]]
    quiet = {
        words: [cell for cell in of.get(group, []) if not cell.label["effects"]]
        for group, words in (("coloured", "autocorrelated noise"), ("jitter", "jitter"))
    }
    rows = [
        ("false alarm on none, given parameters", share(map(_alarm, none)), "≤ 5 %"),
        ("false structural alarm, altered parameters", share(map(_alarm, altered)), "≤ 5 %"),
        ("right effect and joint first, ρ ≥ 0.6", share(c.first for c in single), "≥ 90 %"),
        ("right effect first, any joint, ρ ≥ 0.6", share(c.effect_first for c in single), ""),
        ("mean size of the set", _number([c.set_size for c in named]), "≤ 1.5"),
        ("truth in the first set", share(c.first for c in named), "≥ 95 %"),
        ("pairs, F1", "—" if f1 is None else f"{f1:.2f}", "≥ 0.85"),
        ("outside the catalogue, misnamed", share(map(_alarm, outside)), "≤ 15 %"),
        ("shrinkage over that of the true effect", _number(shrunk), "≥ 0.9"),
        ("parametric cause right first", share(c.first for c in of.get("parametric", [])), ""),
        ("left out of the catalogue, misnamed", share(map(_alarm, of.get("without", []))), ""),
        ("too poor to tell, misnamed", share(map(_alarm, of.get("poor", []))), ""),
        ("too poor to tell, found or said to be", share(c.admitted for c in poor), ""),
        *(
            (f"{name}, no effect: false alarm", share(map(_alarm, quiet[name])), "")
            for name in quiet
        ),
        ("seconds a 6-joint cell, median", f"{median(six):.1f}" if six else "—", "≤ 60"),
        ("seconds a cell, mean", _number([c.seconds for c in cells]), ""),
    ]
    return ["| figure | measured | target |", "|---|---|---|"] + [
        f"| {name} | {value} | {target} |" for name, value, target in rows
    ]


def _breakdown(cells: list[CellScore]) -> list[str]:
    """Right first, of all, for every effect and wanted ratio; unreached ratios apart."""
    table: dict[str, dict[float | str, list[bool]]] = defaultdict(lambda: defaultdict(list))
    for cell in cells:
        if cell.label["group"] == "single":
            truth = cell.label["effects"][0]
            column = truth["rho_wanted"] if truth["reached"] else "not reached"
            table[truth["effect"]][column].append(cell.first)
    columns = [*RATIOS, "not reached"]
    head = "| right first, of all | " + " | ".join(
        f"ρ = {column:g}" if isinstance(column, float) else column for column in columns
    )
    lines = [head + " |", "|---" * (len(columns) + 1) + "|"]
    for effect in sorted(table):
        counts = [table[effect][column] for column in columns]
        lines.append(
            f"| {effect} | " + " | ".join(f"{sum(c)}/{len(c)}" if c else "" for c in counts) + " |"
        )
    return lines


def _failures(scored: Scored) -> list[str]:
    """Kinds of failure with their counts, most frequent first."""
    kinds: Counter[str] = Counter()
    for cell in scored.cells.values():
        label = cell.label
        truth = "+".join(item["effect"] for item in label["effects"]) or "none"
        for alarm in cell.false_alarms:
            kinds[f"{label['group']}: {truth} → {alarm.split('[')[0]}"] += 1
        if label["group"] in ("single", "pair", "parametric") and not all(cell.named):
            missed = [
                item["effect"]
                for item, named in zip(label["effects"], cell.named, strict=True)
                if not named
            ]
            kinds[f"{label['group']}: {'+'.join(missed)} not found"] += 1
    for reason in scored.missing.values():
        kinds[f"no verdict: {reason.splitlines()[-1] if reason else 'no reason given'}"] += 1
    return ["| failure | cells |", "|---|---|"] + [
        f"| {kind} | {count} |" for kind, count in kinds.most_common()
    ]


def _groups(cells: list[CellScore]) -> set[str]:
    return {cell.label["group"] for cell in cells}


def _alarm(cell: CellScore) -> bool:
    return bool(cell.false_alarms)


def _clear(cell: CellScore) -> bool:
    """The effect stands out enough to be asked for."""
    return bool(cell.label["effects"][0]["rho"] >= 0.9 * 0.6)


def _number(values: Sequence[float]) -> str:
    return f"{mean(values):.2f} ({len(values)})" if values else "—"
