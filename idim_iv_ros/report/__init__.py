"""Files and pages made of a result."""

from idim_iv_ros.report.page import gap_report_html, report_html
from idim_iv_ros.report.write import (
    require_writable,
    write_gap_report,
    write_replay_report,
    write_report,
)

__all__ = [
    "gap_report_html",
    "report_html",
    "require_writable",
    "write_gap_report",
    "write_replay_report",
    "write_report",
]
