"""Files and pages made of a result."""

from idim_iv_ros.report.check_json import check_document
from idim_iv_ros.report.gap_format import read_gap
from idim_iv_ros.report.gap_json import gap_document
from idim_iv_ros.report.json_result import result_document
from idim_iv_ros.report.page import gap_report_html, report_html
from idim_iv_ros.report.write import require_writable, write_gap_report, write_report

__all__ = [
    "check_document",
    "gap_document",
    "gap_report_html",
    "read_gap",
    "report_html",
    "require_writable",
    "result_document",
    "write_gap_report",
    "write_report",
]
