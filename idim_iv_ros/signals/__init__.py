"""From a recording to filtered, decimated signals, all columns alike."""

from idim_iv_ros.signals.autoregression import AutoregressiveModel, fit_autoregression
from idim_iv_ros.signals.cutoffs import Cutoffs, choose_cutoffs, motion_bandwidth
from idim_iv_ros.signals.decimation import ParallelDecimation, common_factors, decimation_factor
from idim_iv_ros.signals.filters import (
    butterworth_samples,
    central_differences,
    settling_samples,
    zero_phase_butterworth,
)
from idim_iv_ros.signals.joint_side import JointSignals, JointTransform, joint_side, joint_transform
from idim_iv_ros.signals.motion import (
    REVERSAL_MARGIN,
    Motion,
    difference_order,
    fast_samples,
    filter_motion,
    torque_noise,
)

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
    "common_factors",
    "decimation_factor",
    "difference_order",
    "fast_samples",
    "filter_motion",
    "fit_autoregression",
    "joint_side",
    "joint_transform",
    "motion_bandwidth",
    "settling_samples",
    "torque_noise",
    "zero_phase_butterworth",
]
