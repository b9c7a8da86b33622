"""The findings of a check as plain values."""

from idim_iv_ros.files import CHECK_FORMAT
from idim_iv_ros.identification.check import CheckReport
from idim_iv_ros.report.json_result import Document, plain


def check_document(report: CheckReport) -> Document:
    """Return what `idim-iv check --json` prints; numbers that do not exist are None."""
    document: Document = plain(
        {
            "format": CHECK_FORMAT,
            "usable": report.usable,
            "findings": report.findings,
            "parameters": report.parameters,
            "condition_number": report.condition_number,
        }
    )
    return document
