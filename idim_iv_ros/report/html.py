"""report.html: one file that opens without a network."""

from collections.abc import Callable
from functools import partial

from idim_iv_ros.files import RESULT
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report.guarded import guarded
from idim_iv_ros.report.markup import Html, tag
from idim_iv_ros.report.numerals import with_unit
from idim_iv_ros.report.page import page
from idim_iv_ros.report.sections.glossary import glossary_section
from idim_iv_ros.report.sections.instruments import instruments_section
from idim_iv_ros.report.sections.parameters import parameters_section
from idim_iv_ros.report.sections.processing import processing_section
from idim_iv_ros.report.sections.provenance import provenance_section
from idim_iv_ros.report.sections.residuals import residuals_section
from idim_iv_ros.report.sections.torque import torque_section
from idim_iv_ros.report.sections.verdict import verdict_section

_Draw = Callable[[IdentificationResult], Html]
_SECTIONS: tuple[tuple[str, str, _Draw], ...] = (
    ("Verdict", "verdict", verdict_section),
    ("Parameters", "parameters", parameters_section),
    ("Torque", "torque", torque_section),
    ("Residuals", "residuals", residuals_section),
    ("Instrument tests", "instruments", instruments_section),
    ("Filtered and dropped", "processing", processing_section),
    ("Repeat and cite", "repeat", provenance_section),
    ("Glossary", "glossary", lambda _: glossary_section()),
)


def report_html(result: IdentificationResult) -> str:
    """Return the report as one self-contained HTML document.

    A section that fails leaves its place with one line, and a `ReportWarning`.

    Parameters
    ----------
    result : IdentificationResult
        What `identify` found.
    """
    parts = [
        guarded(title, anchor, partial(draw, result), RESULT) for title, anchor, draw in _SECTIONS
    ]
    return page(
        f"{result.robot}: identification",
        _banner(result),
        [part for part in parts if part is not None],
    )


def _banner(result: IdentificationResult) -> Html:
    joints = f"{len(result.joints)} joint{'s' if len(result.joints) != 1 else ''}"
    seconds = with_unit(sum(bag.duration for bag in result.bags), "s")
    method = {"idim-iv": "IDIM-IV", "idim-ls": "IDIM-LS"}.get(result.estimator, result.estimator)
    return tag(
        "header",
        tag("h1", result.robot, tag("span", " dynamic parameters")),
        tag("p", f"{method} identification of {joints} from {seconds} of recording"),
        tag("nav", [tag("a", words, href=f"#{anchor}") for words, anchor, _ in _SECTIONS]),
    )
