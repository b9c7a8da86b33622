"""A result as the files of a simulator."""

from idim_iv_ros.simulator_files.export import export
from idim_iv_ros.simulator_files.findings import Exported

__all__ = ["Exported", "export"]
