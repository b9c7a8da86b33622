"""Plotly figures as plain dictionaries: one look for all of them."""

import base64
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.report.markup import Html, join, tag

Figure = dict[str, Any]

# Okabe and Ito: told apart by readers with any colour vision, and in grey by their lightness.
INK, MUTED, GRID = "#1f2933", "#5f6b7a", "#e3e7ec"
BLUE, ORANGE, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "#8a94a3"
PALE = "#adb6c2"  # a wide line beneath thin ones
SHADE = "rgba(138, 148, 163, 0.22)"

_FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def typed(values: NDArray[np.floating[Any]] | Sequence[float]) -> dict[str, str]:
    """Return numbers in plotly's binary form, in single precision: a third of their text."""
    data = np.ascontiguousarray(values, dtype="<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(data.tobytes()).decode("ascii")}


def axis(title: str = "", **options: object) -> dict[str, Any]:
    """Return an axis with its title (quantity and unit)."""
    return {
        "title": {"text": title, "standoff": 6, "font": {"size": 12}},
        "automargin": True,
        "gridcolor": GRID,
        "zeroline": False,
        "linecolor": GREY,
        "showline": True,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": GREY,
        "tickfont": {"size": 11},
        "exponentformat": "power",
        **options,
    }


def figure(data: list[dict[str, Any]], axes: Mapping[str, Any], **layout: object) -> Figure:
    """Return a figure of traces and axes in the report's look."""
    return {
        "data": data,
        "layout": {
            "font": {"family": _FONT, "size": 12, "color": INK},
            "paper_bgcolor": "#ffffff",
            "plot_bgcolor": "#ffffff",
            "margin": {"l": 58, "r": 12, "t": 8, "b": 40},
            "showlegend": False,
            "hoverlabel": {"font": {"family": _FONT, "size": 12}},
            "dragmode": "zoom",
            **axes,
            **layout,
        },
    }


def embed(drawing: Figure, anchor: str, height: int, description: str) -> Html:
    """Return the place of a figure in the page; the page's script draws it.

    Parameters
    ----------
    drawing : dict
        Of `figure`.
    anchor : str
        Identifier, unique in the page.
    height : int
        Pixels.
    description : str
        What is shown, for those who cannot see it.
    """
    # In a script element only "<" could end the data, so that it alone is written otherwise.
    data = json.dumps(drawing, ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    return join(
        tag(
            "div",
            css="figure",
            id=anchor,
            style=f"height:{height}px",
            role="img",
            aria_label=description,
        ),
        tag("script", Html(data), type="application/json", data_figure=anchor),
    )


def legend(*entries: tuple[str, str, str]) -> Html:
    """Return a legend in HTML: (mark, colour, words), mark one of line, bar, band, dash, dot."""
    return tag(
        "p",
        [
            tag(
                "span",
                tag("i", css=f"mark {mark}", style=f"--ink:{colour}"),
                words,
                css="entry",
            )
            for mark, colour, words in entries
        ],
        css="legend",
    )
