"""Identification of robot dynamics from ROS 2 recordings by IDIM-IV, with its tests."""

from idim_iv_ros.check import CheckReport, check
from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.errors import DataError, IdimError, UsageError
from idim_iv_ros.identify import identify
from idim_iv_ros.recording import Recording, import_table, read_recordings, write_bag
from idim_iv_ros.report import write_report
from idim_iv_ros.result import IdentificationResult

__all__ = [
    "CheckReport",
    "Configuration",
    "DataError",
    "IdentificationResult",
    "IdimError",
    "Recording",
    "UsageError",
    "check",
    "identify",
    "import_table",
    "load_configuration",
    "read_recordings",
    "write_bag",
    "write_report",
]
