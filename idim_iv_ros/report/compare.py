"""The page of two identifications side by side: every parameter with both intervals."""

from markupsafe import Markup

from idim_iv_ros.files import GENERATOR
from idim_iv_ros.identification.compare import ParameterComparison, ParameterPair
from idim_iv_ros.report.numerals import INTERVAL, measured, number
from idim_iv_ros.report.page import environment, page_parts


def compare_html(comparison: ParameterComparison) -> str:
    """Return the comparison as one self-contained HTML document."""
    section = environment().get_template("compare.html.j2").render(
        anchor="compare",
        badge=("bad", "≠", "differences") if any(pair.differs for pair in comparison.pairs)
        else ("good", "✓", "no difference beyond chance"),
        sentence=comparison.sentence,
        names=comparison.names,
        alone=", ".join(comparison.alone),
        rows=[_row(pair) for pair in comparison.pairs],
    )  # fmt: skip
    return environment().get_template("page.html.j2").render(
        generator=Markup(GENERATOR),
        robot=comparison.robot,
        subject="two identifications",
        subtitle=" and ".join(comparison.names),
        links=[("compare", "Parameters")],
        sections=[Markup(section)],
        **page_parts(),
    )  # fmt: skip


def _row(pair: ParameterPair) -> dict[str, object]:
    """Both values as text, and their intervals as places in percent of the axis of the row."""
    halves = INTERVAL * pair.first_std, INTERVAL * pair.second_std
    values = pair.first, pair.second
    low = min(value - half for value, half in zip(values, halves, strict=True))
    high = max(value + half for value, half in zip(values, halves, strict=True))
    width = max(high - low, 1e-300)
    marks = [
        {
            "start": round(4 + 92 * (value - half - low) / width, 1),
            "length": round(92 * 2 * half / width, 1),
            "middle": round(4 + 92 * (value - low) / width, 1),
        }
        for value, half in zip(values, halves, strict=True)
    ]
    return {
        "pair": pair,
        "first": " ".join(measured(pair.first, pair.first_std)),
        "second": " ".join(measured(pair.second, pair.second_std)),
        "marks": marks,
        "deviations": f"{number(pair.deviations, 2)} σ",
    }
