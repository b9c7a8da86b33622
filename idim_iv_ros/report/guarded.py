"""Sections that cannot take the rest of a report with them when they fail."""

import os
import warnings
from collections.abc import Callable

from idim_iv_ros.errors import ReportWarning, one_line
from idim_iv_ros.report.markup import Html, section, tag


def guarded(title: str, anchor: str, draw: Callable[[], Html | None], numbers: str) -> Html | None:
    """Return a section, or its place with one line where it cannot be drawn.

    A failure is a warning (`ReportWarning`): what was computed is in the file of numbers. With
    ``IDIM_IV_TRACEBACK`` set in the environment it is raised.

    Parameters
    ----------
    title, anchor : str
        Of the place where the section is missing.
    draw : callable
        Returns the section, or None where there is nothing to show.
    numbers : str
        Name of the file that holds all numbers.
    """
    try:
        return draw()
    except Exception as error:
        if os.environ.get("IDIM_IV_TRACEBACK"):
            raise
        what = f"the section “{title}” of the report cannot be drawn ({one_line(error)})"
        warnings.warn(f"{what}; all numbers are in {numbers}", ReportWarning, stacklevel=2)
        sentence = f"{what[0].upper()}{what[1:]}. All numbers are in {numbers}."
        return section(title, anchor, tag("p", sentence, css="warning"))
