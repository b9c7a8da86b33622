"""The words of the field that a report uses."""

from typing import Any

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.report.section import Report, Section


def _context(report: Report[Any]) -> dict[str, Any]:
    return {"diagnosis": isinstance(report.result, GapResult)}


GLOSSARY: Section[Any] = Section(
    "Glossary", "glossary", "glossary.html.j2", _context, "what the words of this page mean"
)
