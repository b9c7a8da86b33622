"""Given and new values, by URDF element and configuration key."""

from typing import Any

from idim_iv_ros.report.changes import SUM, changed_values
from idim_iv_ros.report.section import Report, Section


def _context(report: Report[Any]) -> dict[str, Any] | None:
    rows = changed_values(report.result, report.nominal)
    if not rows:
        return None
    return {
        "single": [row for row in rows if row.source != SUM and row.significant is not False],
        "kept": [row for row in rows if row.source != SUM and row.significant is False],
        "sums": [row for row in rows if row.source == SUM],
        "config": report.config,
        "given_known": any(row.given is not None for row in rows),
    }


CHANGES: Section[Any] = Section("Given → new", "changes", "changes.html.j2", _context)
