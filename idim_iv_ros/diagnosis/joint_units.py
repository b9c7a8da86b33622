"""Units of an effect's numbers at a joint that slides, or whose effort is a current."""

from dataclasses import replace

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.model import units


def unit_at(data: Baseline, joint: int, unit: str) -> str:
    """Translate units, also within words, from those of a joint that turns, torque in N m."""
    joint_type = data.prepared.model.robot.joint_types[joint]
    return units.unit_at(unit, joint_type, data.prepared.configuration.signals.effort_unit)


def in_units_of(
    data: Baseline, joint: int, parameters: dict[str, EffectParameter]
) -> dict[str, EffectParameter]:
    """Parameters with the units that they have at a joint."""
    return {
        name: replace(parameter, unit=unit_at(data, joint, parameter.unit))
        for name, parameter in parameters.items()
    }
