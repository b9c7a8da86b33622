"""The physically consistent parameters of a result, or the reason why it has none."""

from collections.abc import Collection, Sequence

from idim_iv_ros.errors import DataError
from idim_iv_ros.estimation.rows import JointRows
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.physical import PhysicalParameters, nearest_physical
from idim_iv_ros.physical.nearest import TO_INSTALL
from idim_iv_ros.physical.torque_error import Judge
from idim_iv_ros.types import FloatArray


def consistent_parameters(
    prepared: PreparedRegression,
    values: FloatArray,
    covariance: FloatArray,
    rows: Sequence[JointRows],
    sigma: FloatArray,
    shared: Collection[str] = (),
) -> tuple[PhysicalParameters | None, str]:
    """Return the nearest physical parameters and nothing, or None and why there are none.

    Parameters
    ----------
    values, covariance : (b,), (b, b)
        The refined estimate.
    rows, sigma
        On which the torque is judged, and the residual's standard deviation of each joint.
    shared
        Friction parameters that effects share.
    """
    unit = prepared.configuration.signals.effort_unit
    if unit != "N m":
        return None, (
            f"efforts are in {unit}: whether a body is possible is known in kg m² only; give "
            "torque constant times gear ratio as signals.effort_scale, and effort_unit N m"
        )
    if prepared.configuration.identification.exclude:
        return None, (
            "identification.exclude takes base parameters out of the model: the links that are "
            "left are no bodies"
        )
    if not prepared.model.robot.has_inertials:
        return None, (
            "the URDF gives no inertia: nothing says how the sums that a recording shows are split "
            "into links; write rough masses and inertias into it"
        )
    model = prepared.model
    try:
        judge = Judge(rows, len(values), sigma)
        found = nearest_physical(model.robot, model.base, values, covariance, judge, shared)
    except ImportError:
        return None, TO_INSTALL
    except DataError as error:
        return None, str(error)
    return found, ""
