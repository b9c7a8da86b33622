"""Units at a joint: those of a joint that turns, translated for one that slides or has no N m."""

import re


def unit_at(unit: str, joint_type: str, effort_unit: str = "N m") -> str:
    """Return a unit as it is at a joint, also within words.

    Parameters
    ----------
    unit : str
        As it is at a revolute joint whose effort is a torque in N m: ``rad``, ``mrad/s``,
        ``N m s/rad``, ``kg m²``.
    joint_type : str
        ``revolute`` or ``prismatic``.
    effort_unit : str
        ``N m``, or ``A`` or ``V`` where the effort is a motor current or voltage.
    """
    slides = joint_type == "prismatic"
    if effort_unit != "N m":
        unit = unit.replace("kg m²", f"{effort_unit} s²/rad").replace("N m", effort_unit)
    elif slides:
        unit = unit.replace("kg m²", "kg").replace("N m", "N")
    return re.sub(r"\b(m?)rad\b", r"\1m", unit) if slides else unit
