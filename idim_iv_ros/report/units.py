"""Unit of each joint's torque."""

from idim_iv_ros.result import IdentificationResult


def torque_unit(result: IdentificationResult, joint: int) -> str:
    """Return the unit of the torque of a joint: N m, N for a prismatic joint, A or V.

    Parameters
    ----------
    joint : int
        Index of the joint from 0.
    """
    for name in (f"Fc{joint + 1}", f"off{joint + 1}"):
        for parameter in result.parameters:
            if parameter.name == name:
                return parameter.unit
    return result.effort_unit


def torque_word(unit: str) -> str:
    """Return what a quantity with that unit is called."""
    return {"N m": "Torque", "N": "Force", "A": "Motor current", "V": "Motor voltage"}.get(
        unit, "Effort"
    )
