"""Units of each joint's torque and speed."""

from idim_iv_ros.identification.result import IdentificationResult


def torque_unit(result: IdentificationResult, joint: int) -> str:
    """Return the unit of the torque of a joint: N m, N for a prismatic joint, A or V.

    Parameters
    ----------
    joint : int
        Index of the joint from 0.
    """
    if result.effort_unit == "N m" and result.joint_types[joint] == "prismatic":
        return "N"
    return result.effort_unit


def speed_unit(result: IdentificationResult, joint: int) -> str:
    """Return the unit of the speed of a joint (index from 0)."""
    return "m/s" if result.joint_types[joint] == "prismatic" else "rad/s"


def torque_word(unit: str) -> str:
    """Return what a quantity with that unit is called."""
    return {"N m": "Torque", "N": "Force", "A": "Motor current", "V": "Motor voltage"}.get(
        unit, "Effort"
    )
