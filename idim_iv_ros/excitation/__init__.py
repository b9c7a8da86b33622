"""Design of motions that identify a robot or separate the causes of a gap."""

from idim_iv_ros.excitation.criterion import condition_numbers, predict_parameters
from idim_iv_ros.excitation.design import DesignSettings, design_excitation
from idim_iv_ros.excitation.diagnosis import Diagnosis, design_diagnosis
from idim_iv_ros.excitation.excite import (
    Excitation,
    excite,
    load_model,
    random_motion,
    servo_motion,
)
from idim_iv_ros.excitation.files import (
    diagnosis_document,
    require_place,
    write_joint_trajectory,
    write_motion,
)
from idim_iv_ros.excitation.limits import LimitUse, MotionLimits, motion_limits
from idim_iv_ros.excitation.passes import Passes, passes_of, plan_passes, slowed, stop
from idim_iv_ros.excitation.trajectory import (
    Trajectory,
    read_trajectory,
    require_sampling,
    write_csv,
)

__all__ = [
    "DesignSettings",
    "Diagnosis",
    "Excitation",
    "LimitUse",
    "MotionLimits",
    "Passes",
    "Trajectory",
    "condition_numbers",
    "design_diagnosis",
    "design_excitation",
    "diagnosis_document",
    "excite",
    "load_model",
    "motion_limits",
    "passes_of",
    "plan_passes",
    "predict_parameters",
    "random_motion",
    "read_trajectory",
    "require_place",
    "require_sampling",
    "servo_motion",
    "slowed",
    "stop",
    "write_csv",
    "write_joint_trajectory",
    "write_motion",
]
