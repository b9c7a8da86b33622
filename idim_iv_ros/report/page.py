"""report.html: a self-contained page of sections that opens without a network."""

import base64
import gzip
from collections.abc import Sequence
from functools import cache
from importlib import resources
from inspect import getmembers, isfunction
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.effects.cause import surest
from idim_iv_ros.excitation.diagnosis import separating_motion
from idim_iv_ros.files import GENERATOR
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report import advice, gap_words, numerals
from idim_iv_ros.report.numerals import plural, with_unit
from idim_iv_ros.report.section import UNPLACED, Files, R, Report, Section
from idim_iv_ros.report.sections import drives, parameters, provenance, torque, validation
from idim_iv_ros.report.sections.robot import robot_drawing

_TORQUE = Section("Torque", "torque", torque.torque)
_CHANGES = Section("Given → new", "changes", parameters.changes)
_PHYSICAL = Section("Physical", "physical", parameters.physical)
_REPEAT = Section("Repeat", "repeat", provenance.repeat)
_GLOSSARY: Section[Any] = Section("Glossary", "glossary")
IDENTIFICATION: tuple[Section[Any], ...] = (
    Section("Verdict", "verdict"),
    _TORQUE,
    _CHANGES,
    Section("Parameters", "parameters"),
    _PHYSICAL,
    Section("Residuals", "residuals"),
    Section("Tests", "instruments"),
    Section("Processing", "processing", provenance.processing),
    _REPEAT,
    _GLOSSARY,
)
DIAGNOSIS: tuple[Section[Any], ...] = (
    Section("What changed", "contrast"),
    Section("Verdict", "verdict", template="gap_verdict"),
    Section("Friction", "friction"),
    _TORQUE,
    Section("Causes", "causes"),
    _CHANGES,
    Section("Shrinkage", "stages"),
    Section("Residual", "residuals", template="residual_curves"),
    Section("Regimes", "where"),
    Section("Tracking", "tracking", torque.tracking),
    Section("Transmissions", "transmissions"),
    _PHYSICAL,
    Section("Limits", "limits"),
    Section("Notes", "notes"),
    _REPEAT,
    _GLOSSARY,
)


def report_html(result: IdentificationResult, files: Files = UNPLACED) -> str:
    """Return the report of an identification as one self-contained HTML document.

    A section that fails is replaced by one line, with a `ReportWarning`. `files` are the paths in
    the commands on the page.
    """
    what = f"{result.estimator.upper()} identification of {plural(len(result.joints), 'joint')}"
    seconds = with_unit(sum(bag.duration for bag in result.bags), "s")
    sections = _sections(Report(result, files), IDENTIFICATION)
    return page_html(
        result.robot, "dynamic parameters", f"{what} from {seconds} of recording", sections
    )


def gap_report_html(result: GapResult, files: Files = UNPLACED) -> str:
    """Return the report of a diagnosis as one self-contained HTML document; see `report_html`."""
    seconds = with_unit(gap_words.duration(result), "s")
    of = f"Diagnosis of {plural(len(result.joints), 'joint')} from {seconds} of recording"
    sections = _sections(Report(result, files), DIAGNOSIS)
    return page_html(result.robot, "sim-to-real gap", of, sections)


@cache
def environment() -> Environment:
    """Return the environment of the templates: text is escaped, undefined names are errors.

    Functions of `numerals` are filters, and those that say or draw something may be called.
    """
    templates = Environment(
        loader=PackageLoader("idim_iv_ros.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= dict(getmembers(numerals, isfunction))
    for module in (gap_words, advice, drives, validation, parameters):
        templates.globals |= dict(getmembers(module, isfunction))
    templates.globals |= {
        **{"badges": advice.BADGES, "families": advice.FAMILIES, "surest": surest},
        "robot_drawing": robot_drawing,
        "separating_motion": separating_motion,
        "torque_figure": torque.torque_figure,
        "tracking_figure": torque.tracking_figure,
        "waterfall": torque.waterfall,
    }
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
