"""What a known shaft, or play, does to the torques of all joints."""

from dataclasses import replace

import numpy as np

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Columns, Regression
from idim_iv_ros.effects.two_masses import transmitted

_LIGHT_DAMPING = 0.03  # times critical, of a shaft where none shows


def link_inertia(data: Baseline, joint: int) -> float:
    """Inertia of what is behind a joint, about it: median over the motion, kg m²."""
    inertia = np.concatenate([motion.inertia[:, joint, joint] for motion in data.motions])
    return max(float(np.median(inertia)), 1e-12)


def twist_torques(
    data: Baseline, joint: int, stiffness: float, damping: float | None, gap: float
) -> Columns:
    """Change of all torques against a rigid transmission, (r, 1) by joint.

    Parameters
    ----------
    stiffness, gap
        N m/rad, rad.
    damping
        N m s/rad; None: light, where none was measured.
    """
    if damping is None:
        critical = 2.0 * float(np.sqrt(stiffness * link_inertia(data, joint)))
        damping = _LIGHT_DAMPING * critical
    parts = [transmitted(motion, joint, stiffness, damping, gap) for motion in data.motions]
    pairs = list(zip(data.motions, parts, strict=True))
    return {
        other: data.counting(other, [motion.rows(part[other]) for motion, part in pairs])
        for other in parts[0]
    }


def less(regression: Regression, columns: Columns) -> Regression:
    """Return the same rows with a known torque (r, 1) taken off."""
    joints = tuple(
        replace(rows, torque=rows.torque - columns[joint][:, 0]) if joint in columns else rows
        for joint, rows in enumerate(regression.joints)
    )
    return Regression(joints, regression.parameters)
