"""The tests of instruments, specification and exogeneity, with what they mean in plain words."""

from collections.abc import Sequence
from typing import Any

from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.numerals import count, exact, number, p_value, percent, sentence
from idim_iv_ros.report.section import Report, Section
from idim_iv_ros.statistics import HypothesisTest


def _context(report: Report[IdentificationResult]) -> dict[str, Any]:
    result = report.result
    tests = result.instruments
    failures = [f"Tried before and failed: {failure}" for failure in tests.failures]
    return {
        "source": tests.source,
        "remarks": [sentence(text) for text in [*failures, *tests.notes]],
        "validity": _table(tests.tests, ("Effect, % of torque", "Largest |Π̂ − I|")),
        "specification": _table(result.specification.tests, ("Effect, % of torque",)),
        "exogeneity": _table(result.exogeneity.tests, (), neutral=True),
        "alpha": exact(100.0 * tests.alpha, "%"),
    }


def _table(
    tests: Sequence[HypothesisTest], sizes: Sequence[str], *, neutral: bool = False
) -> dict[str, Any]:
    """Rows of a table of tests; `reason` where none was run.

    `neutral`: neither outcome is bad news.
    """
    reasons = {test.reason for test in tests}
    alone = len(reasons) == 1 and all(test.accepted is None for test in tests)
    return {
        "reason": reasons.pop() if alone else "",
        "sizes": sizes,
        "untested": _badge(None, neutral=neutral),
        "rows": [_row(test, len(sizes), neutral=neutral) for test in tests],
    }


def _row(test: HypothesisTest, sizes: int, *, neutral: bool) -> dict[str, Any]:
    everything = test.scope == "all"
    numbers: list[str] = []
    if test.accepted is not None:
        df = count(test.df or 0)
        law = f"χ²({df})" if test.df_denom is None else f"F({df}, {count(test.df_denom)})"
        numbers = [f"{law} = {number(test.statistic, 3)}", p_value(test.p_value)]
        effects = [percent(test.torque_deviation_percent), number(test.max_deviation, 2)]
        numbers += effects[:sizes]
    return {
        "scope": "all joints" if everything else test.scope,
        "everything": everything,
        "badge": _badge(test.accepted, neutral=neutral),
        "numbers": numbers,
        "reason": test.reason,
    }


def _badge(accepted: bool | None, *, neutral: bool) -> tuple[str, str, str]:
    if accepted is None:
        return "open", "–", "not tested"
    words = "accepted" if accepted else "rejected"
    if neutral:
        return "fair", "=" if accepted else "≠", words
    return ("good", "✓", words) if accepted else ("bad", "✕", words)


INSTRUMENTS = Section(
    "Tests",
    "instruments",
    "instruments.html.j2",
    _context,
    "Durbin-Wu-Hausman: whether the instruments are valid and least squares biased",
)
