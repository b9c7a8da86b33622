"""Rows of unit changes of all numbers that a nominal model may have wrong."""

import numpy as np

from idim_iv_ros.diagnosis.identifiability import too_little
from idim_iv_ros.diagnosis.likelihood import Regression
from idim_iv_ros.diagnosis.refit.baseline import Baseline, operating_range
from idim_iv_ros.diagnosis.refit.refit import unit_gravity_rows
from idim_iv_ros.effects.parametric_effect import ParameterSpace
from idim_iv_ros.types import FloatArray


def still_joints(data: Baseline) -> frozenset[int]:
    """Joints that move too little to show any change."""
    covered = operating_range(data)
    return frozenset(joint for joint in range(len(data.joints)) if too_little(joint, covered))


def change_rows(
    data: Baseline, regression: Regression, space: ParameterSpace
) -> tuple[FloatArray, ...]:
    """Rows (r_j, d) of unit changes of all numbers of a space, for each joint, N m."""
    b, units = regression.parameters, []
    gravity = _gravity_rows(data, space.axes)
    for joint, rows in enumerate(regression.joints):
        unit = np.zeros((len(rows), space.size))
        unit[:, rows.columns] = rows.matrix
        unit[:, b : b + 2] = gravity[joint]
        unit[:, b + 2 + joint] = rows.prediction(space.given)
        units.append(unit)
    return tuple(units)


def level_axes(gravity: FloatArray) -> FloatArray:
    """Two unit vectors (2, 3) at right angles to gravity, as near to x, y, z as they can be."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return np.eye(3)[:2]
    down = gravity / size
    kept = sorted(range(3), key=lambda axis: abs(down[axis]))[:2]
    first = np.eye(3)[min(kept)]
    first = first - (first @ down) * down
    first = first / np.linalg.norm(first)
    second = np.cross(down, first)
    return np.array([first, second if second[max(kept)] > 0.0 else -second])


def _gravity_rows(data: Baseline, axes: FloatArray) -> list[FloatArray]:
    """Torque per small rotation of gravity about each axis: (r_j, 2) for each joint, N m/rad."""
    gravity = np.asarray(data.prepared.model.robot.pinocchio.gravity.linear)
    return unit_gravity_rows(data, np.array([np.cross(axis, gravity) for axis in axes]))
