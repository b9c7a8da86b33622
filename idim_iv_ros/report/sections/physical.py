"""The physically consistent parameters: links before and after, bounds, and what was given."""

from typing import Any

from idim_iv_ros.report.numerals import is_number
from idim_iv_ros.report.section import Report, Section

_LARGE = 0.1  # σ from which the change of a base parameter is listed


def _context(report: Report[Any]) -> dict[str, Any] | None:
    physical = report.result.physical
    if physical is None and not report.result.why_no_physical:
        return None
    moved = [
        parameter
        for parameter in (physical.base if physical is not None else ())
        if is_number(parameter.deviations) and abs(parameter.deviations) >= _LARGE
    ]
    return {
        "physical": physical,
        "moved": sorted(moved, key=lambda parameter: -abs(parameter.deviations)),
        "numbers": report.files.here(report.numbers),
    }


PHYSICAL: Section[Any] = Section(
    "Physical",
    "physical",
    "physical.html.j2",
    _context,
    "masses, centres and inertias that a simulator can hold",
)
