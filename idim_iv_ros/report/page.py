"""The frame of every report: styles, plotly and the page's script in one file."""

from collections.abc import Sequence
from importlib import resources

from plotly.offline import get_plotlyjs

from idim_iv_ros.files import GENERATOR
from idim_iv_ros.report.markup import Html, join, tag
from idim_iv_ros.report.script import SCRIPT


def page(
    title: str, banner: Html, sections: Sequence[Html], *, styles: Sequence[str] = ("report.css",)
) -> str:
    """Return a self-contained HTML document.

    Parameters
    ----------
    title : str
    banner : Html
        Above the sections.
    sections : sequence of Html
    styles : sequence of str
        Files beside this one, later ones over earlier ones.
    """
    folder = resources.files(__package__)
    style = "\n".join(folder.joinpath(name).read_text("utf-8") for name in styles)
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        Html(GENERATOR),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(style)),
        tag("script", Html(get_plotlyjs())),
    )
    body = tag("body", banner, tag("main", sections), tag("script", Html(SCRIPT)))
    return join(Html("<!DOCTYPE html>\n"), tag("html", head, body, lang="en"), "\n")
