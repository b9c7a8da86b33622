"""report.html: a self-contained page of sections that opens without a network."""

import base64
import gzip
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.files import GENERATOR
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report import gap_words, numerals
from idim_iv_ros.report.changes import CHANGES
from idim_iv_ros.report.numerals import plural, with_unit
from idim_iv_ros.report.section import UNPLACED, Files, R, Report, Section
from idim_iv_ros.report.sections.causes import CAUSES, CONTRAST
from idim_iv_ros.report.sections.drives import FRICTION, TRANSMISSIONS
from idim_iv_ros.report.sections.parameters import PARAMETERS, PHYSICAL
from idim_iv_ros.report.sections.provenance import GLOSSARY, LIMITS, NOTES, PROCESSING, PROVENANCE
from idim_iv_ros.report.sections.residual_curves import RESIDUAL_CURVES
from idim_iv_ros.report.sections.stages import REGIMES, STAGES
from idim_iv_ros.report.sections.torque import TORQUE, TRACKING
from idim_iv_ros.report.sections.validation import INSTRUMENTS, RESIDUALS
from idim_iv_ros.report.sections.verdict import GAP_VERDICT, VERDICT

IDENTIFICATION: tuple[Section[Any], ...] = (
    VERDICT,
    TORQUE,
    CHANGES,
    PARAMETERS,
    PHYSICAL,
    RESIDUALS,
    INSTRUMENTS,
    PROCESSING,
    PROVENANCE,
    GLOSSARY,
)
DIAGNOSIS: tuple[Section[Any], ...] = (
    CONTRAST,
    GAP_VERDICT,
    FRICTION,
    TORQUE,
    CAUSES,
    CHANGES,
    STAGES,
    RESIDUAL_CURVES,
    REGIMES,
    TRACKING,
    TRANSMISSIONS,
    PHYSICAL,
    LIMITS,
    NOTES,
    PROVENANCE,
    GLOSSARY,
)
_METHODS = {"idim-iv": "IDIM-IV", "idim-ls": "IDIM-LS"}


def report_html(result: IdentificationResult, files: Files = UNPLACED) -> str:
    """Return the report of an identification as one self-contained HTML document.

    A section that fails is replaced by one line, with a `ReportWarning`. `files` are the paths in
    the commands on the page.
    """
    seconds = sum(bag.duration for bag in result.bags)
    method = _METHODS.get(result.estimator, result.estimator)
    return page_html(
        result.robot,
        "dynamic parameters",
        f"{method} identification of {plural(len(result.joints), 'joint')} from "
        f"{with_unit(seconds, 's')} of recording",
        _sections(Report(result, files), IDENTIFICATION),
    )


def gap_report_html(result: GapResult, files: Files = UNPLACED) -> str:
    """Return the report of a diagnosis as one self-contained HTML document; see `report_html`."""
    return page_html(
        result.robot,
        "sim-to-real gap",
        f"Diagnosis of {plural(len(result.joints), 'joint')} from "
        f"{with_unit(gap_words.duration(result), 's')} of recording",
        _sections(Report(result, files), DIAGNOSIS),
    )


@cache
def environment() -> Environment:
    """Return the environment of the templates: text is escaped, undefined names are errors."""
    templates = Environment(
        loader=PackageLoader("idim_iv_ros.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    for name in ("number", "round_number", "exact", "count", "measured", "with_digits_of",
                 "percent", "p_value", "with_unit", "sentence", "plural", "with_interval",
                 "share"):  # fmt: skip
        templates.filters[name] = getattr(numerals, name)
    for name in ("torque_unit", "unit_in", "effect_at", "parameter_words"):
        templates.globals[name] = getattr(gap_words, name)
    templates.tests["finite"] = numerals.is_number
    return templates


def _sections(report: Report[R], sections: Sequence[Section[R]]) -> list[tuple[str, str, Markup]]:
    drawn = [(section, section.render(report, environment())) for section in sections]
    return [(section.anchor, section.title, text) for section, text in drawn if text is not None]


def page_html(
    robot: str, subject: str, subtitle: str, sections: Sequence[tuple[str, str, Markup]]
) -> str:
    """Return a self-contained page of sections: anchor, title in the navigation, and content."""
    return environment().get_template("page.html.j2").render(
        generator=Markup(GENERATOR),
        robot=robot,
        subject=subject,
        subtitle=subtitle,
        sections=sections,
        **page_parts(),
    )  # fmt: skip


def one_section(template: str, anchor: str, title: str, **shown: Any) -> tuple[str, str, Markup]:
    """Return a section (anchor, title, content) rendered from a template and its variables."""
    text = environment().get_template(template).render(anchor=anchor, title=title, **shown)
    return anchor, title, Markup(text)


@cache
def page_parts() -> dict[str, str]:
    """Return style, script and compressed plotly, as ``page.html.j2`` embeds them.

    Compression makes plotly two thirds smaller; the page's script inflates it.
    """
    folder = resources.files(__package__).joinpath("assets")
    packed = gzip.compress(get_plotlyjs().encode(), 9, mtime=0)
    return {
        "style": Markup(folder.joinpath("report.css").read_text("utf-8")),
        "script": Markup(folder.joinpath("report.js").read_text("utf-8")),
        "plotly": base64.b64encode(packed).decode("ascii"),
    }
