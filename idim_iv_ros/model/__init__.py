"""The inverse dynamic model: regressor, standard and base parameters."""

from idim_iv_ros.model.base_parameters import BaseParameters, find_base_parameters
from idim_iv_ros.model.inverse_model import (
    InverseModel,
    build_inverse_model,
    configured_robot,
    require_same_robot,
)
from idim_iv_ros.model.parameters import DynamicParameters, StandardParameter, parameter_layout
from idim_iv_ros.model.regressor import StandardRegressor
from idim_iv_ros.model.robot import JointLimits, RobotModel, kinematics_digest, load_robot
from idim_iv_ros.model.urdf import read_urdf_file, read_urdf_text

__all__ = [
    "BaseParameters",
    "DynamicParameters",
    "InverseModel",
    "JointLimits",
    "RobotModel",
    "StandardParameter",
    "StandardRegressor",
    "build_inverse_model",
    "configured_robot",
    "find_base_parameters",
    "kinematics_digest",
    "load_robot",
    "parameter_layout",
    "read_urdf_file",
    "read_urdf_text",
    "require_same_robot",
]
