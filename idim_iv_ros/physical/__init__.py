"""The physically consistent parameters nearest to an estimate."""

from idim_iv_ros.physical.nearest import nearest_physical
from idim_iv_ros.physical.result import (
    BaseChange,
    LinkInertia,
    PhysicalParameters,
    StandardValue,
    TorqueError,
)

__all__ = [
    "BaseChange",
    "LinkInertia",
    "PhysicalParameters",
    "StandardValue",
    "TorqueError",
    "nearest_physical",
]
