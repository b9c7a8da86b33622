"""Two versions of the code on the same cells: what changed, and whether by chance (McNemar)."""

from collections.abc import Mapping

from scipy.stats import binomtest

from benchmarks.hostile.figures import FIGURES, Ask
from benchmarks.hostile.judge import Answer


def changes(
    first: Mapping[str, Answer], second: Mapping[str, Answer], ask: Ask
) -> tuple[list[str], list[str]]:
    """Cells whose answer became a yes, and cells whose answer is a yes no more."""
    gained, lost = [], []
    for name in sorted(first.keys() & second.keys()):
        before, after = ask(first[name]), ask(second[name])
        if before is None or after is None or before == after:
            continue
        (gained if after else lost).append(name)
    return gained, lost


def mcnemar(gained: int, lost: int) -> float:
    """p-value of as many changes one way as the other: exact, two-sided (McNemar 1947)."""
    return float(binomtest(gained, gained + lost).pvalue) if gained + lost else 1.0


def comparison_lines(first: Mapping[str, Answer], second: Mapping[str, Answer]) -> list[str]:
    """A row a figure, and a row a cell whose outcome is another."""
    common = sorted(first.keys() & second.keys())
    lines = [
        f"{len(common)} cells that both answered.",
        "",
        "| figure | A | B | only B | only A | p (McNemar, exact) |",
        "|---|---|---|---|---|---|",
    ]
    for figure in FIGURES:
        pairs = [(figure.ask(first[name]), figure.ask(second[name])) for name in common]
        asked = [(a, b) for a, b in pairs if a is not None and b is not None]
        gained, lost = changes(first, second, figure.ask)
        lines.append(
            f"| {figure.name} | {sum(a for a, _ in asked)}/{len(asked)} "
            f"| {sum(b for _, b in asked)}/{len(asked)} | {len(gained)} | {len(lost)} "
            f"| {mcnemar(len(gained), len(lost)):.2g} |"
        )
    lines += ["", "| cell | there | A | B |", "|---|---|---|---|"]
    for name in common:
        before, after = first[name], second[name]
        if before.outcome != after.outcome:
            there = ", ".join(
                effect.get("form") or effect["effect"] for effect in before.label["effects"]
            )
            lines.append(f"| {name} | {there or '–'} | {_said(before)} | {_said(after)} |")
    return lines


def _said(cell: Answer) -> str:
    causes = "; ".join(words.replace("|", "\\|") for words in cell.said)
    return f"{cell.outcome}: {causes or cell.verdict}"
