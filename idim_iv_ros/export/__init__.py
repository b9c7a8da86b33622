"""A result as the files of a simulator."""

from idim_iv_ros.export.export import Exported, export

__all__ = ["Exported", "export"]
