"""Files and pages made of a result."""

from idim_iv_ros.report.html import report_html
from idim_iv_ros.report.json_result import result_document
from idim_iv_ros.report.write import require_writable, write_report

__all__ = ["report_html", "require_writable", "result_document", "write_report"]
