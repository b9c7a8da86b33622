"""report.html of a diagnosis: one file that opens without a network."""

from collections.abc import Callable
from functools import partial

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.files import GAP
from idim_iv_ros.report.gap_sections.causes import causes_section
from idim_iv_ros.report.gap_sections.glossary import gap_glossary_section
from idim_iv_ros.report.gap_sections.limits import limits_section
from idim_iv_ros.report.gap_sections.orders import orders_section
from idim_iv_ros.report.gap_sections.provenance import gap_provenance_section, notes_section
from idim_iv_ros.report.gap_sections.residuals import residuals_section
from idim_iv_ros.report.gap_sections.stages import stages_section
from idim_iv_ros.report.gap_sections.torque import torque_section
from idim_iv_ros.report.gap_sections.tracking import tracking_section
from idim_iv_ros.report.gap_sections.verdict import verdict_section
from idim_iv_ros.report.gap_sections.where import where_section
from idim_iv_ros.report.gap_words import duration
from idim_iv_ros.report.guarded import guarded
from idim_iv_ros.report.markup import Html, tag
from idim_iv_ros.report.numerals import with_unit
from idim_iv_ros.report.page import page

_Draw = Callable[[GapResult], Html | None]
_SECTIONS: tuple[tuple[str, str, _Draw], ...] = (
    ("Verdict", "verdict", verdict_section),
    ("Shrinkage", "stages", stages_section),
    ("Causes", "causes", causes_section),
    ("Regimes", "where", where_section),
    ("Residual", "residuals", residuals_section),
    ("Orders", "orders", orders_section),
    ("Torque", "torque", torque_section),
    ("Tracking", "tracking", tracking_section),
    ("Cannot tell", "limits", limits_section),
    ("Notes", "notes", notes_section),
    ("Repeat", "repeat", gap_provenance_section),
    ("Glossary", "glossary", lambda _: gap_glossary_section()),
)


def gap_report_html(result: GapResult) -> str:
    """Return the report of a diagnosis as one self-contained HTML document.

    A section that fails leaves its place with one line, and a `ReportWarning`.

    Parameters
    ----------
    result : GapResult
        What `diagnose` found.
    """
    drawn = [
        (title, anchor, guarded(title, anchor, partial(draw, result), GAP))
        for title, anchor, draw in _SECTIONS
    ]
    shown = [(title, anchor, part) for title, anchor, part in drawn if part is not None]
    return page(
        f"{result.robot}: sim-to-real gap",
        _banner(result, [(title, anchor) for title, anchor, _ in shown]),
        [part for *_, part in shown],
        styles=("report.css", "gap.css"),
    )


def _banner(result: GapResult, links: list[tuple[str, str]]) -> Html:
    joints = f"{len(result.joints)} joint{'s' if len(result.joints) != 1 else ''}"
    seconds = with_unit(duration(result), "s")
    return tag(
        "header",
        tag("h1", result.robot, tag("span", " sim-to-real gap")),
        tag("p", f"Diagnosis of {joints} from {seconds} of recording"),
        tag("nav", [tag("a", words, href=f"#{anchor}") for words, anchor in links]),
    )
