"""A result as the files of a simulator."""

from idim_iv_ros.simulator_files.export import Exported, export

__all__ = ["Exported", "export"]
