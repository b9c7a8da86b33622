"""The inverse dynamic model: regressor, standard and base parameters."""

from idim_iv_ros.model.base_parameters import BaseParameters, find_base_parameters
from idim_iv_ros.model.inverse_model import InverseModel, build_inverse_model
from idim_iv_ros.model.parameters import (
    DynamicParameters,
    ParameterLayout,
    StandardParameter,
    parameter_layout,
)
from idim_iv_ros.model.regressor import StandardRegressor
from idim_iv_ros.model.robot import JointLimits, RobotModel, load_robot

__all__ = [
    "BaseParameters",
    "DynamicParameters",
    "InverseModel",
    "JointLimits",
    "ParameterLayout",
    "RobotModel",
    "StandardParameter",
    "StandardRegressor",
    "build_inverse_model",
    "find_base_parameters",
    "load_robot",
    "parameter_layout",
]
