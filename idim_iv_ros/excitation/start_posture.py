"""Check of a posture at rest that the user asks for."""

from idim_iv_ros.errors import UsageError
from idim_iv_ros.excitation.limits import MotionLimits
from idim_iv_ros.types import FloatArray


def require_inside(start: FloatArray, limits: MotionLimits, joints: tuple[str, ...]) -> None:
    """Refuse a start posture (n_joints,) that leaves no room within the position limits.

    Raises
    ------
    UsageError
        One line: wrong length, or the first joint outside its limits with the margin.
    """
    if len(start) != len(joints):
        raise UsageError(f"start has {len(start)} values for {len(joints)} joints")
    inner = limits.margin * limits.half_range
    for joint, value, middle, room in zip(joints, start, limits.middle, inner, strict=True):
        if not abs(value - middle) < room:
            raise UsageError(
                f"start of joint {joint}, {value:g}, lies outside {middle - room:.4g} to "
                f"{middle + room:.4g} (its limits with the margin)"
            )
