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

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.files import GENERATOR
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report import gap_words, numerals
from idim_iv_ros.report.section import CONFIGURATION, R, Report, Section
from idim_iv_ros.report.sections.causes import CAUSES
from idim_iv_ros.report.sections.changes import CHANGES
from idim_iv_ros.report.sections.contrast import CONTRAST
from idim_iv_ros.report.sections.friction import FRICTION
from idim_iv_ros.report.sections.glossary import GLOSSARY
from idim_iv_ros.report.sections.instruments import INSTRUMENTS
from idim_iv_ros.report.sections.limits import LIMITS
from idim_iv_ros.report.sections.orders import ORDERS
from idim_iv_ros.report.sections.parameters import PARAMETERS
from idim_iv_ros.report.sections.physical import PHYSICAL
from idim_iv_ros.report.sections.processing import PROCESSING
from idim_iv_ros.report.sections.provenance import NOTES, PROVENANCE
from idim_iv_ros.report.sections.regimes import REGIMES
from idim_iv_ros.report.sections.residual_curves import RESIDUAL_CURVES
from idim_iv_ros.report.sections.residuals import RESIDUALS
from idim_iv_ros.report.sections.stages import STAGES
from idim_iv_ros.report.sections.torque import TORQUE
from idim_iv_ros.report.sections.tracking import TRACKING
from idim_iv_ros.report.sections.transmissions import TRANSMISSIONS
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
    ORDERS,
    TRACKING,
    TRANSMISSIONS,
    PHYSICAL,
    LIMITS,
    NOTES,
    PROVENANCE,
    GLOSSARY,
)
_METHODS = {"idim-iv": "IDIM-IV", "idim-ls": "IDIM-LS"}


def report_html(result: IdentificationResult, config: str = CONFIGURATION) -> str:
    """Return the report of an identification as one self-contained HTML document.

    A section that fails leaves its place with one line, and a `ReportWarning`.

    Parameters
    ----------
    result : IdentificationResult
        What `identify` found.
    config : str
        The robot's configuration file as commands in the report name it.
    """
    seconds = sum(bag.duration for bag in result.bags)
    method = _METHODS.get(result.estimator, result.estimator)
    return _page(
        Report(result, config),
        IDENTIFICATION,
        "dynamic parameters",
        f"{method} identification of {_joints(result)} from {_seconds(seconds)} of recording",
    )


def gap_report_html(result: GapResult, config: str = CONFIGURATION) -> str:
    """Return the report of a diagnosis as one self-contained HTML document.

    A section that fails leaves its place with one line, and a `ReportWarning`.

    Parameters
    ----------
    result : GapResult
        What `diagnose` found.
    config : str
        The robot's configuration file as commands in the report name it.
    """
    seconds = _seconds(gap_words.duration(result))
    return _page(
        Report(result, config),
        DIAGNOSIS,
        "sim-to-real gap",
        f"Diagnosis of {_joints(result)} from {seconds} of recording",
    )


@cache
def environment() -> Environment:
    """Return the templates: text is escaped, and a name that is not given is an error."""
    templates = Environment(
        loader=PackageLoader("idim_iv_ros.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    for name in ("number", "round_number", "exact", "count", "measured", "beside", "percent",
                 "p_value", "with_unit", "sentence"):  # fmt: skip
        templates.filters[name] = getattr(numerals, name)
    return templates


def _page(report: Report[R], sections: Sequence[Section[R]], subject: str, subtitle: str) -> str:
    drawn = [(section, section.render(report, environment())) for section in sections]
    shown = [(section, text) for section, text in drawn if text is not None]
    return environment().get_template("page.html.j2").render(
        generator=Markup(GENERATOR),
        robot=report.result.robot,
        subject=subject,
        subtitle=subtitle,
        links=[(section.anchor, section.title) for section, _ in shown],
        sections=[text for _, text in shown],
        **page_parts(),
    )  # fmt: skip


@cache
def page_parts() -> dict[str, str]:
    """Style, script and compressed plotly of a page, as ``page.html.j2`` embeds them.

    Plotly is two thirds smaller when it is compressed; the page's script inflates it.
    """
    folder = resources.files(__package__).joinpath("assets")
    packed = gzip.compress(get_plotlyjs().encode(), 9, mtime=0)
    return {
        "style": Markup(folder.joinpath("report.css").read_text("utf-8")),
        "script": Markup(folder.joinpath("report.js").read_text("utf-8")),
        "plotly": base64.b64encode(packed).decode("ascii"),
    }


def _joints(result: IdentificationResult | GapResult) -> str:
    return f"{len(result.joints)} joint{'s' if len(result.joints) != 1 else ''}"


def _seconds(seconds: float) -> str:
    return numerals.with_unit(seconds, "s")
