"""From a recording to filtered, decimated signals, all columns alike."""

from idim_iv_ros.signals.autoregression import AutoregressiveModel, fit_autoregression
from idim_iv_ros.signals.cutoffs import Cutoffs, choose_cutoffs
from idim_iv_ros.signals.decimation import ParallelDecimation
from idim_iv_ros.signals.filters import (
    butterworth_samples,
    central_differences,
    shifted,
    zero_phase_butterworth,
)
from idim_iv_ros.signals.joint_side import JointSignals, JointTransform, joint_side, joint_transform
from idim_iv_ros.signals.motion import REVERSAL_MARGIN, Motion, filter_motion, torque_noise

__all__ = [
    "REVERSAL_MARGIN",
    "AutoregressiveModel",
    "Cutoffs",
    "JointSignals",
    "JointTransform",
    "Motion",
    "ParallelDecimation",
    "butterworth_samples",
    "central_differences",
    "choose_cutoffs",
    "filter_motion",
    "fit_autoregression",
    "joint_side",
    "joint_transform",
    "shifted",
    "torque_noise",
    "zero_phase_butterworth",
]
