"""What the nominal model leaves of the measured torque."""

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.types import FloatArray


def nominal_residuals(data: Baseline, regression: Regression) -> tuple[FloatArray, ...] | None:
    """Measured torque less that of the nominal model: (r_j,) N m (N) of each joint."""
    values = data.prepared.given
    if values is None:
        return None
    return tuple(rows.torque - rows.matrix @ values[rows.columns] for rows in regression.joints)
