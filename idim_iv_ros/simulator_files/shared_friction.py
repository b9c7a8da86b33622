"""Friction below zero that an effect makes up for, as effects: no simulator has it as a number."""

from collections.abc import Mapping, Sequence

from idim_iv_ros.effects.registry import STRUCTURAL
from idim_iv_ros.simulators.effects_file import PlantedEffect


def below_zero(values: Mapping[str, float], joints: Sequence[str]) -> tuple[PlantedEffect, ...]:
    """Fv and Fc below zero as effects that are the same torque (`Cause.instead_of`).

    The sum of a joint's friction is what is simulated, and kept from driving.
    """
    return tuple(
        PlantedEffect(effect.name, name, None, numbers)
        for joint, name in enumerate(joints, 1)
        for kind in ("Fv", "Fc")
        if values.get(f"{kind}{joint}", 0.0) < 0.0
        for effect in STRUCTURAL
        if (numbers := effect.instead_of(kind, values[f"{kind}{joint}"]))
    )
