"""Plotly figures as plain dictionaries, all in one style, for light and dark pages."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from idim_iv_ros.encoding import json_text

# Variables of the stylesheet: the page's script puts the values of the present scheme there.
# Okabe and Ito: distinguished by readers with any colour vision, and in grey by their lightness.
INK, MUTED = "var(--ink)", "var(--muted)"
BLUE, ORANGE, GREY = "var(--blue)", "var(--orange)", "var(--grey)"
SHADE = "var(--shade)"
# Colours of the directions of motion, none of which is that of a model.
FORWARD, BACKWARD = "var(--forward)", "var(--backward)"
FORWARD_BAND, BACKWARD_BAND = "var(--forward-band)", "var(--backward-band)"

Values = NDArray[np.floating[Any]]
# Levels of a packed number, and the one that stands for none.
_LEVELS, BREAK = 65534, 65535
_DOTS = 200  # of one cloud


@dataclass(frozen=True)
class Figure:
    """A figure of a page: plotly's traces and layout, height in pixels.

    `anchor` is unique in the page; `description` is the alternative text.
    """

    anchor: str
    height: int
    description: str
    data: list[dict[str, Any]]
    layout: dict[str, Any]

    @property
    def json(self) -> Markup:
        """Return data and layout as JSON that is safe inside a script element: without "<"."""
        content = {"data": self.data, "layout": self.layout}
        return Markup(json_text(content, indent=None).replace("<", "\\u003c"))


def typed(values: Values | Sequence[float]) -> dict[str, Any]:
    """Return values (n,) packed as 16-bit integers with scale, which the page's script unpacks.

    They take a sixth of the text, and resolve more than the pixels of a screen. A number that is
    not finite interrupts a line.
    """
    numbers = np.asarray(values, dtype=float)
    finite = np.isfinite(numbers)
    ends = numbers[finite] if finite.any() else np.zeros(1)
    low, high = float(ends.min()), float(ends.max())
    step = (high - low) / _LEVELS or 1.0
    scaled = np.where(finite, np.round((np.where(finite, numbers, low) - low) / step), BREAK)
    data = base64.b64encode(scaled.astype("<u2").tobytes()).decode("ascii")
    return {"levels": data, "low": low, "step": step}


def scatter(x: object, y: object, mode: str, **options: object) -> dict[str, Any]:
    """Return a trace through points (n,) each, in a mode of plotly: lines, markers or none."""
    return {"type": "scatter", "mode": mode, "x": x, "y": y, **options}


def line(
    x: object, y: Values, colour: str, width: float, hover: str, mode: str = "lines", **options: Any
) -> dict[str, Any]:
    """Return a trace of a line through `y` (n,); ``{"same": k}`` is the `x` of trace k."""
    style = {"line": {"color": colour, "width": width}, "hovertemplate": f"{hover}<extra></extra>"}
    along = x if isinstance(x, dict) else typed(np.asarray(x))
    return scatter(along, typed(y), mode, **style, **options)


def dots(x: Values, y: Values, colour: str, size: float = 2.6) -> dict[str, Any]:
    """Return a trace of samples `x`, `y` (n,); if there are many, of some drawn at random.

    Every n-th sample of a periodic motion would always be at the same place.
    """
    count = min(_DOTS, len(x))
    chosen = np.sort(np.random.default_rng(0).choice(len(x), count, replace=False))
    marker = {"color": colour, "size": size, "opacity": 0.28, "line": {"width": 0}}
    return scatter(typed(x[chosen]), typed(y[chosen]), "markers", marker=marker, hoverinfo="skip")


def outline(x: Values, y: Values, colour: str, **options: object) -> dict[str, Any]:
    """Return a trace of a filled area with the corners `x`, `y` (n,), without a line."""
    style = {"fill": "toself", "fillcolor": colour, "hoverinfo": "skip"}
    return scatter(typed(x), typed(y), "none", **style, **options)


def band(x: tuple[object, object], y: tuple[float, float], **options: object) -> dict[str, Any]:
    """Return a shaded rectangle below the traces."""
    style = {"type": "rect", "fillcolor": SHADE, "line": {"width": 0}, "layer": "below"}
    return {**style, "x0": x[0], "x1": x[1], "y0": y[0], "y1": y[1], **options}


def axis(title: str = "", **options: object) -> dict[str, Any]:
    """Return an axis with its title (quantity and unit); its style is in the page's script."""
    return {"title": {"text": title}, **options}


@dataclass(frozen=True)
class TimeCurve:
    """A curve over time, in the upper or lower (`below`) panel; `words` are shown on hovering."""

    values: Values
    colour: str
    width: float
    words: str
    below: bool = False


def over_time(
    anchor: str,
    height: int,
    description: str,
    time: Values,
    drawn: Sequence[TimeCurve],
    titles: tuple[str, str],
    split: float,
    *,
    behind: Sequence[dict[str, Any]] = (),
    **options: object,
) -> Figure:
    """Return a figure of curves over `time` (n,), s, in two panels with `titles` of their axes.

    - `split`: share of the height that is below the upper panel
    - `behind`: traces that are drawn before the curves
    """
    data = list(behind)
    for curve in drawn:
        x = time if len(data) == len(behind) else {"same": len(behind)}
        place = {"yaxis": "y2"} if curve.below else {}
        hover = f"{curve.words} at %{{x:.3f}} s"
        data.append(line(x, curve.values, curve.colour, curve.width, hover, **place))
    axes = {
        "xaxis": axis("Time, s", anchor="y2"),
        "yaxis": axis(titles[0], domain=[split, 1.0], nticks=6),
        "yaxis2": axis(titles[1], domain=[0.0, split - 0.08], nticks=4),
    }
    return Figure(anchor, height, description, data, {**axes, **options})
