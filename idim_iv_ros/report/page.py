"""report.html: a self-contained page of sections that opens without a network."""

import base64
import gzip
from collections.abc import Callable, Sequence
from functools import cache, partial
from importlib import resources
from inspect import getmembers, isfunction
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from plotly.offline import get_plotlyjs

from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.files import GENERATOR
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.report import gap_words, numerals
from idim_iv_ros.report.figures import Figure
from idim_iv_ros.report.numerals import plural, with_unit
from idim_iv_ros.report.section import UNPLACED, Files, R, Report, Section
from idim_iv_ros.report.sections import (
    drives,
    parameters,
    provenance,
    torque,
    validation,
    verdict,
)


def _drawn(figure: Callable[[Any, Any], Figure]) -> Callable[[Report[Any]], dict[str, Any]]:
    """Return the context of a section whose template asks for figures of a result's series."""
    return lambda report: {"figure": partial(figure, report.result)}


_TORQUE = Section("Torque", "torque", torque.torque)
_CHANGES = Section("Given → new", "changes", parameters.changes)
_PHYSICAL = Section("Physical", "physical", parameters.physical)
_REPEAT = Section("Repeat", "repeat", provenance.repeat)
_GLOSSARY: Section[Any] = Section("Glossary", "glossary")
IDENTIFICATION: tuple[Section[Any], ...] = (
    Section("Verdict", "verdict", verdict.identification),
    _TORQUE,
    _CHANGES,
    Section("Parameters", "parameters", lambda report: {"typeset": parameters.typeset}),
    _PHYSICAL,
    Section("Residuals", "residuals", _drawn(validation.autocorrelation)),
    Section("Tests", "instruments"),
    Section("Processing", "processing", provenance.processing),
    _REPEAT,
    _GLOSSARY,
)
DIAGNOSIS: tuple[Section[Any], ...] = (
    Section("What changed", "contrast", verdict.contrast),
    Section("Verdict", "verdict", verdict.diagnosis, "gap_verdict"),
    Section("Friction", "friction", _drawn(drives.friction_figure)),
    _TORQUE,
    Section("Causes", "causes", verdict.causes),
    _CHANGES,
    Section("Shrinkage", "stages", torque.stages),
    Section("Residual", "residuals", _drawn(drives.residual_figure), "residual_curves"),
    Section("Regimes", "where"),
    Section("Tracking", "tracking", torque.tracking),
    Section("Transmissions", "transmissions", _drawn(drives.twist_figure)),
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
    seconds = sum(bag.duration for bag in result.bags)
    return page_html(
        result.robot,
        "dynamic parameters",
        f"{result.estimator.upper()} identification of {plural(len(result.joints), 'joint')} from "
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
    """Return the environment of the templates: text is escaped, undefined names are errors.

    Functions of `numerals` are filters, and those of `gap_words` may be called.
    """
    templates = Environment(
        loader=PackageLoader("idim_iv_ros.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= dict(getmembers(numerals, isfunction))
    templates.globals |= dict(getmembers(gap_words, isfunction))
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
