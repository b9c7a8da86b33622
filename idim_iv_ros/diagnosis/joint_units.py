"""Units of an effect's numbers at a joint that slides, or whose effort is a current."""

import re
from dataclasses import replace

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter


def unit_at(data: Baseline, joint: int, unit: str) -> str:
    """Translate units, also within words, from those of a joint that turns, torque in N m."""
    slides = data.prepared.model.robot.joint_types[joint] == "prismatic"
    effort = data.prepared.configuration.signals.effort_unit
    if effort == "N m":
        if slides:
            unit = unit.replace("kg m²", "kg").replace("N m", "N")
    else:
        unit = unit.replace("kg m²", f"{effort} s²/rad").replace("N m", effort)
    return re.sub(r"\brad\b", "m", unit) if slides else unit


def in_units_of(
    data: Baseline, joint: int, parameters: dict[str, EffectParameter]
) -> dict[str, EffectParameter]:
    """Parameters with the units that they have at a joint."""
    return {
        name: replace(parameter, unit=unit_at(data, joint, parameter.unit))
        for name, parameter in parameters.items()
    }
