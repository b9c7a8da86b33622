"""The rows of the refit on the smooth motion: what candidates are added to."""

import numpy as np

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.estimation.rows import JointRows


def smooth_regression(data: Baseline) -> Regression:
    """Regress the measured torque on the smooth motion, with friction that sticks."""
    model = data.prepared.model
    parts: list[list[np.ndarray]] = [[] for _ in data.joints]
    for motion in data.motions:
        matrices = model.joint_matrices(motion.position, motion.velocity, motion.acceleration)
        for joint, matrix in enumerate(matrices):
            names = [model.base.names[column] for column in data.rows[joint].columns]
            if f"Fc{joint + 1}" in names:
                matrix[:, names.index(f"Fc{joint + 1}")] = motion.slip[:, joint]
            parts[joint].append(motion.rows(matrix)[motion.kept[:, joint]])
    joints = tuple(
        JointRows(np.concatenate(part), rows.torque, rows.columns, rows.segments, rows.name)
        for rows, part in zip(data.rows, parts, strict=True)
    )
    return Regression(joints, len(model.base.columns))
