"""report.html: one file that opens without a network."""

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
from idim_iv_ros.result import IdentificationResult

_LINKS = (
    ("verdict", "Verdict"),
    ("parameters", "Parameters"),
    ("torque", "Torque"),
    ("residuals", "Residuals"),
    ("instruments", "Instrument tests"),
    ("processing", "Filtered and dropped"),
    ("repeat", "Repeat and cite"),
    ("glossary", "Glossary"),
)


def report_html(result: IdentificationResult) -> str:
    """Return the report as one self-contained HTML document.

    Parameters
    ----------
    result : IdentificationResult
        What `identify` found.
    """
    return page(
        f"{result.robot}: identification",
        _banner(result),
        [
            verdict_section(result),
            parameters_section(result),
            torque_section(result),
            residuals_section(result),
            instruments_section(result),
            processing_section(result),
            provenance_section(result),
            glossary_section(),
        ],
    )


def _banner(result: IdentificationResult) -> Html:
    joints = f"{len(result.joints)} joint{'s' if len(result.joints) != 1 else ''}"
    seconds = with_unit(sum(bag.duration for bag in result.bags), "s")
    method = {"idim-iv": "IDIM-IV", "idim-ls": "IDIM-LS"}.get(result.estimator, result.estimator)
    return tag(
        "header",
        tag("h1", result.robot, tag("span", " dynamic parameters")),
        tag("p", f"{method} identification of {joints} from {seconds} of recording"),
        tag("nav", [tag("a", words, href=f"#{anchor}") for anchor, words in _LINKS]),
    )
