"""Design of motions that identify a robot or tell the causes of a gap apart."""

from idim_iv_ros.excitation.criterion import ConditionNumbers, condition_numbers
from idim_iv_ros.excitation.design import Design, design_excitation
from idim_iv_ros.excitation.design_settings import DesignSettings
from idim_iv_ros.excitation.diagnosis import Diagnosis, design_diagnosis
from idim_iv_ros.excitation.documents import diagnosis_document, segment_table
from idim_iv_ros.excitation.excite import Excitation, excite, load_model
from idim_iv_ros.excitation.files import require_place, write_motion
from idim_iv_ros.excitation.joint_trajectory import require_message_rate, write_joint_trajectory
from idim_iv_ros.excitation.limit_use import LimitUse, limit_use
from idim_iv_ros.excitation.limits import MotionLimits, motion_limits
from idim_iv_ros.excitation.prediction import PredictedParameter, predict_parameters
from idim_iv_ros.excitation.random_motion import random_motion
from idim_iv_ros.excitation.sampling import require_sampling
from idim_iv_ros.excitation.segment import Segment
from idim_iv_ros.excitation.trajectory import Trajectory, read_trajectory, write_csv

__all__ = [
    "ConditionNumbers",
    "Design",
    "DesignSettings",
    "Diagnosis",
    "Excitation",
    "LimitUse",
    "MotionLimits",
    "PredictedParameter",
    "Segment",
    "Trajectory",
    "condition_numbers",
    "design_diagnosis",
    "design_excitation",
    "diagnosis_document",
    "excite",
    "limit_use",
    "load_model",
    "motion_limits",
    "predict_parameters",
    "random_motion",
    "read_trajectory",
    "require_message_rate",
    "require_place",
    "require_sampling",
    "segment_table",
    "write_csv",
    "write_joint_trajectory",
    "write_motion",
]
