"""The abscissa of figures over time: the recordings of a session, one after the other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.recording import SessionPart
from idim_iv_ros.report.figures import GREY, MUTED
from idim_iv_ros.types import FloatArray, IntArray

# Of the length of all recordings: no pause between two is drawn longer.
_WIDEST_PAUSE = 0.02
# Pixels of a narrow plot and of a letter of its names: longer names would cover each other.
_WIDTH, _LETTER = 480.0, 6.0
# More recordings than this are not even numbered.
_NUMBERED = 20


@dataclass(frozen=True)
class SessionAxis:
    """Where the recordings of a session are drawn.

    Attributes
    ----------
    parts : tuple of SessionPart
        In their order; empty where nothing is known of them.
    drawn : tuple of float
        Start of each recording on the axis, s.
    """

    parts: tuple[SessionPart, ...]
    drawn: tuple[float, ...]

    @property
    def shortened(self) -> bool:
        """Whether a pause is drawn shorter than it was."""
        return any(
            part.start - self.parts[0].start > place + 1e-9
            for part, place in zip(self.parts, self.drawn, strict=True)
        )

    @property
    def words(self) -> str:
        """What a reader has to know of several recordings; empty for one."""
        if len(self.parts) < 2:
            return ""
        pauses = ", pauses shortened" if self.shortened else ""
        names = ""
        if len(self.parts) <= _NUMBERED and not self._names_fit:
            listed = [f"{number + 1} {part.bag}" for number, part in enumerate(self.parts)]
            names = f": {', '.join(listed)}"
        return f" Recordings follow one another in the order of their stamps{pauses}{names}."

    @property
    def _names_fit(self) -> bool:
        """Whether the name of each recording is shorter than its part of the axis."""
        whole = self.drawn[-1] + self.parts[-1].duration
        ends = [*self.drawn[1:], whole]
        return all(
            _LETTER * len(part.bag) <= _WIDTH * (end - start) / whole
            for part, start, end in zip(self.parts, self.drawn, ends, strict=True)
        )

    def recording(self, time: FloatArray) -> IntArray:
        """Recording of each time of the session, (r,)."""
        if not self.parts:
            return np.zeros(len(time), dtype=np.int64)
        starts = [part.start for part in self.parts]
        place = np.searchsorted(starts, time, side="right") - 1
        return np.asarray(np.maximum(place, 0), dtype=np.int64)

    def ends(self, time: FloatArray) -> IntArray:
        """Rows after which another recording begins."""
        return np.flatnonzero(np.diff(self.recording(time)))

    def on_axis(self, time: FloatArray) -> FloatArray:
        """Places (r,) on the axis, s."""
        if not self.parts:
            return time
        shift = np.array(self.drawn) - [part.start for part in self.parts]
        return np.asarray(time + shift[self.recording(time)])

    def marks(self) -> dict[str, Any]:
        """Layout of a figure: a line where each recording starts, with its name or number."""
        if len(self.parts) < 2:
            return {}
        lines = [
            {
                "type": "line",
                "x0": place,
                "x1": place,
                "y0": 0.0,
                "y1": 1.0,
                "yref": "paper",
                "line": {"color": GREY, "width": 1, "dash": "dot"},
            }
            for place in self.drawn[1:]
        ]
        if len(self.parts) > _NUMBERED:
            return {"shapes": lines}
        words = [part.bag if self._names_fit else f"{k + 1}" for k, part in enumerate(self.parts)]
        names = [
            {
                "x": place,
                "y": 1.0,
                "yref": "paper",
                "text": word.replace("&", "&amp;").replace("<", "&lt;"),
                "showarrow": False,
                "xanchor": "left",
                "yanchor": "bottom",
                "font": {"size": 10, "color": MUTED},
            }
            for place, word in zip(self.drawn, words, strict=True)
        ]
        # Room for the names above the plot.
        margin = {"l": 58, "r": 12, "t": 22, "b": 40}
        return {"shapes": lines, "annotations": names, "margin": margin}


def session_axis(parts: Sequence[SessionPart]) -> SessionAxis:
    """Place recordings on an axis, pauses between them no longer than can be seen."""
    widest = _WIDEST_PAUSE * sum(part.duration for part in parts)
    drawn: list[float] = []
    for number, part in enumerate(parts):
        if number == 0:
            drawn.append(0.0)
            continue
        before = parts[number - 1]
        step = part.start - before.start
        drawn.append(drawn[-1] + min(step, before.duration + widest))
    return SessionAxis(tuple(parts), tuple(drawn))


def axis_of_identification(result: IdentificationResult) -> SessionAxis:
    """Return that of an identification."""
    return session_axis(
        [SessionPart(_name(bag.path), bag.session_start, bag.duration) for bag in result.bags]
    )


def axis_of_diagnosis(result: GapResult) -> SessionAxis:
    """Return that of a diagnosis."""
    return session_axis(result.session)


def _name(path: str) -> str:
    return path.rsplit("/", 1)[-1]
