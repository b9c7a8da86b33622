"""The page of two identifications side by side: every parameter with both intervals."""

from idim_iv_ros.identification.compare import ParameterComparison, ParameterPair
from idim_iv_ros.report.advice import Step
from idim_iv_ros.report.numerals import measured, number
from idim_iv_ros.report.page import one_section, page_html
from idim_iv_ros.report.section import UNPLACED, Files


def compare_html(comparison: ParameterComparison, files: Files = UNPLACED) -> str:
    """Return the comparison of two identifications as one self-contained HTML document."""
    differ = any(pair.differs for pair in comparison.pairs)
    section = one_section(
        "compare.html.j2",
        "compare",
        "Parameters",
        badge=("bad", "≠", "differences") if differ else ("good", "✓", "no difference"),
        result=comparison,
        steps=[compare_step(comparison, files)],
        pair_words=pair_words,
    )
    subtitle = " and ".join(comparison.names)
    return page_html(comparison.robot, "two identifications", subtitle, [section])


def compare_step(comparison: ParameterComparison, files: Files) -> Step:
    """Return the next step: diagnose what changed, or identify from all recordings together."""
    first, second = comparison.bags
    if any(pair.differs for pair in comparison.pairs):
        line = files.command("diagnose", *first, "--against", *second, out="changed")
        return Step("Find out which effect changed, and by how much:", line)
    line = files.command("identify", *first, *second, out="together")
    return Step("Identify from all recordings together, with smaller intervals:", line)


def pair_words(pair: ParameterPair) -> tuple[str, str, str]:
    """Return both values with their intervals, and how many standard deviations they differ by."""
    first = " ".join(measured(pair.first, pair.first_std))
    second = " ".join(measured(pair.second, pair.second_std))
    return first, second, f"{number(pair.deviations, 2)} σ"
