"""The given model: its base parameters, and what it leaves of the measured torque."""

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.likelihood import Regression

FloatArray = NDArray[np.float64]


def given_values(data: Baseline) -> FloatArray | None:
    """Base parameters (b,) of the given model, None where the URDF has no inertials."""
    model = data.prepared.model
    return model.given if model.robot.has_inertials else None


def given_residuals(data: Baseline, regression: Regression) -> tuple[FloatArray, ...] | None:
    """Measured torque less that of the given model: (r_j,) N m (N) of each joint."""
    values = given_values(data)
    if values is None:
        return None
    return tuple(rows.torque - rows.matrix @ values[rows.columns] for rows in regression.joints)
