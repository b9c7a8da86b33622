"""The physically consistent parameters nearest to an estimate."""

from idim_iv_ros.physical.nearest import nearest_physical
from idim_iv_ros.physical.result import PhysicalParameters, StandardValue

__all__ = ["PhysicalParameters", "StandardValue", "nearest_physical"]
