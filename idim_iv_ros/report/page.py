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
from idim_iv_ros.effects.registry import parameter_words
from idim_iv_ros.excitation.diagnosis import separating_motion
from idim_iv_ros.files import GENERATOR
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report import advice, gap_words, numerals
from idim_iv_ros.report.numerals import plural, with_unit
from idim_iv_ros.report.section import UNPLACED, Files, Report, Section
from idim_iv_ros.report.sections import (
    drives,
    parameters,
    provenance,
    robot,
    torque,
    validation,
)

IDENTIFICATION = (
    Section("Verdict", "verdict"),
    Section("Torque", "torque"),
    Section("Given → new", "changes"),
    Section("Parameters", "parameters"),
    Section("Physical", "physical"),
    Section("Residuals", "residuals"),
    Section("Tests", "instruments"),
    Section("Processing", "processing"),
    Section("Repeat", "repeat"),
    Section("Glossary", "glossary"),
)
DIAGNOSIS = (
    Section("What changed", "contrast"),
    Section("Verdict", "verdict", "gap_verdict"),
    Section("Friction", "friction"),
    Section("Torque", "torque"),
    Section("Causes", "causes"),
    Section("Given → new", "changes"),
    Section("Shrinkage", "stages"),
    Section("Residual", "residuals", "residual_curves"),
    Section("Regimes", "where"),
    Section("Tracking", "tracking"),
    Section("Transmissions", "transmissions"),
    Section("Physical", "physical"),
    Section("Limits", "limits"),
    Section("Notes", "notes"),
    Section("Repeat", "repeat"),
    Section("Glossary", "glossary"),
)


def report_html(result: IdentificationResult, files: Files = UNPLACED) -> str:
    """Return the report of an identification as one self-contained HTML document.

    A section that fails is replaced by one line, with a `ReportWarning`. `files` are the paths in
    the commands on the page.
    """
    estimator, joints = result.estimator.upper(), plural(len(result.joints), "joint")
    seconds = with_unit(sum(bag.duration for bag in result.bags), "s")
    subtitle = f"{estimator} identification of {joints} from {seconds} of recording"
    sections = _sections(Report(result, files), IDENTIFICATION)
    return page_html(result.robot, "dynamic parameters", subtitle, sections)


def gap_report_html(result: GapResult, files: Files = UNPLACED) -> str:
    """Return the report of a diagnosis as one self-contained HTML document; see `report_html`."""
    seconds = with_unit(gap_words.duration(result), "s")
    subtitle = f"Diagnosis of {plural(len(result.joints), 'joint')} from {seconds} of recording"
    sections = _sections(Report(result, files), DIAGNOSIS)
    return page_html(result.robot, "sim-to-real gap", subtitle, sections)


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
    for module in (gap_words, advice, drives, parameters, provenance, robot, torque, validation):
        for name, function in getmembers(module, isfunction):
            if function.__module__ == module.__name__ and not name.startswith("_"):
                templates.globals[name] = function
    templates.globals |= {"badges": advice.BADGES, "families": advice.FAMILIES}
    templates.globals |= {"surest": surest, "separating_motion": separating_motion}
    templates.globals |= {"parameter_words": parameter_words, "is_interval": numerals.is_interval}
    templates.tests["finite"] = numerals.is_number
    return templates


def _sections(report: Report[Any], sections: Sequence[Section]) -> list[tuple[str, str, Markup]]:
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
