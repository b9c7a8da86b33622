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
    physical = result.physical
    if physical is None:
        return {"found": None, "reason": result.why_no_physical} if result.why_no_physical else None
    numbers = report.files.here(report.numbers)
    return {
        "found": physical,
        "reason": "",
        "links": [_link(link) for link in physical.links],
        "moved": [
            (
                parameter.name,
                number(parameter.estimate),
                number(parameter.value),
                f"{parameter.deviations:+.2f}",
            )
            for parameter in sorted(physical.base, key=lambda parameter: -abs(parameter.deviations))
            if is_number(parameter.deviations) and abs(parameter.deviations) >= _LARGE
        ],
        "values": [_value(parameter) for parameter in physical.parameters],
        "error": _error(physical),
        "p_value": p_value(physical.test.p_value),
        "distance": number(physical.test.statistic),
        "command": report.files.command("export", numbers, out="simulator"),
    }


def _link(link: LinkInertia) -> tuple[str, ...]:
    eigenvalues = ", ".join(number(value, 2) for value in link.eigenvalues)
    bound = "held by the bound" if link.active else ""
    return (
        link.joint,
        number(link.smallest_before, 2),
        number(link.smallest_after, 2),
        eigenvalues,
        bound,
    )


def _value(parameter: StandardValue) -> tuple[str, ...]:
    value, spread = measured(parameter.value, parameter.std)
    return (
        parameter.name,
        f"{value} {spread}".strip(),
        number(parameter.given),
        parameter.unit,
        _SOURCES[parameter.source],
    )


def _error(physical: PhysicalParameters) -> list[tuple[str, str, str]]:
    error = physical.torque_error
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
