"""The physically consistent parameters: links before and after, bounds, and what was given."""

from typing import Any

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.identification.result import IdentificationResult
from idim_iv_ros.physical import LinkInertia, PhysicalParameters, StandardValue
from idim_iv_ros.report.numerals import is_number, measured, number, p_value, percent
from idim_iv_ros.report.section import Report, Section

_LARGE = 0.1  # σ from which the change of a base parameter is listed
_SOURCES = {
    "recording": "recording",
    "recording and nominal model": "recording, split by the URDF",
    "nominal model": "URDF",
}


def _context(report: Report[Any]) -> dict[str, Any] | None:
    result: IdentificationResult | GapResult = report.result
    found = result.physical
    if found is None:
        return {"found": None, "reason": result.why_no_physical} if result.why_no_physical else None
    numbers = report.files.here(report.numbers)
    return {
        "found": found,
        "reason": "",
        "links": [_link(link) for link in found.links],
        "moved": [
            (each.name, number(each.estimate), number(each.value), f"{each.deviations:+.2f}")
            for each in sorted(found.base, key=lambda each: -abs(each.deviations))
            if is_number(each.deviations) and abs(each.deviations) >= _LARGE
        ],
        "values": [_value(parameter) for parameter in found.parameters],
        "error": _error(found),
        "p_value": p_value(found.test.p_value),
        "distance": number(found.test.statistic),
        "command": report.files.command("export", numbers, out="simulator"),
    }


def _link(each: LinkInertia) -> tuple[str, ...]:
    eigenvalues = ", ".join(number(value, 2) for value in each.eigenvalues)
    held = "held by the bound" if each.active else ""
    return (
        each.joint,
        number(each.smallest_before, 2),
        number(each.smallest_after, 2),
        eigenvalues,
        held,
    )


def _value(each: StandardValue) -> tuple[str, ...]:
    value, spread = measured(each.value, each.std)
    return (
        each.name,
        f"{value} {spread}".strip(),
        number(each.given),
        each.unit,
        _SOURCES[each.source],
    )


def _error(found: PhysicalParameters) -> list[tuple[str, str, str]]:
    error = found.torque_error
    if error is None:
        return []
    rows = [("all rows", percent(error.before), percent(error.after))]
    if error.held_out_before is not None and error.held_out_after is not None:
        rows.append(("held out", percent(error.held_out_before), percent(error.held_out_after)))
    return rows


PHYSICAL: Section[Any] = Section(
    "Physical",
    "physical",
    "physical.html.j2",
    _context,
    "masses, centres and inertias that a simulator can hold",
)
