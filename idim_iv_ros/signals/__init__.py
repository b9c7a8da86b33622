"""From a recording to filtered, decimated signals, all columns alike."""

from idim_iv_ros.signals.autoregression import AutoregressiveModel, fit_autoregression
from idim_iv_ros.signals.cutoffs import Cutoffs, choose_cutoffs, motion_bandwidth
from idim_iv_ros.signals.decimation import ParallelDecimation, common_factors, decimation_factor
from idim_iv_ros.signals.filters import central_differences, zero_phase_butterworth
from idim_iv_ros.signals.joint_side import JointSignals, JointTransform, joint_side, joint_transform
from idim_iv_ros.signals.motion import (
    REVERSAL_MARGIN,
    Motion,
    coarser,
    difference_order,
    fast_samples,
    filter_motion,
)
from idim_iv_ros.signals.noise import torque_noise
from idim_iv_ros.signals.settling import butterworth_samples, settling_samples

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
    "coarser",
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
