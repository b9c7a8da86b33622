"""Friction below zero that an effect makes up for, as effects: no simulator has it as a number."""

from collections.abc import Mapping, Sequence

from idim_iv_ros.simulators.effects_file import PlantedEffect

_NEVER = 1e6  # rad/s, a Stribeck speed that no joint comes near: the excess is constant


def below_zero(values: Mapping[str, float], joints: Sequence[str]) -> tuple[PlantedEffect, ...]:
    """Fv below zero as a drag of power 1, Fc below zero as an excess at every speed.

    The sum of a joint's friction is what is simulated, and kept from driving.
    """
    found = []
    for joint, name in enumerate(joints):
        viscous = values.get(f"Fv{joint + 1}", 0.0)
        coulomb = values.get(f"Fc{joint + 1}", 0.0)
        if viscous < 0.0:
            numbers = {"coefficient": viscous, "power": 1.0}
            found.append(PlantedEffect("nonlinear_viscous", name, None, numbers))
        if coulomb < 0.0:
            numbers = {"excess": coulomb, "speed": _NEVER}
            found.append(PlantedEffect("stribeck", name, None, numbers))
    return tuple(found)
