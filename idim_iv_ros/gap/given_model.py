"""What the given model leaves of the measured torque."""

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.gap.baseline import Baseline
from idim_iv_ros.gap.likelihood import Regression

FloatArray = NDArray[np.float64]


def given_residuals(data: Baseline, regression: Regression) -> tuple[FloatArray, ...] | None:
    """Measured torque less that of the given model: (r_j,) N m (N) of each joint."""
    values = data.prepared.given
    if values is None:
        return None
    return tuple(rows.torque - rows.matrix @ values[rows.columns] for rows in regression.joints)
