"""Viscous and Coulomb friction that are not the nominal ones: age, temperature, another grease."""

from collections.abc import Sequence

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
)

_NAMES = {"Fv": "change_of_viscous", "Fc": "change_of_coulomb"}


class FrictionLevel(ParametricEffect):
    """Changes of both friction parameters of one joint."""

    name = "friction_level"
    order = 40
    confounders = ("torque_gain", "stribeck", "load_dependent_friction")
    excitation = "slow and fast motion in both directions"
    segments = ("plateau",)
    specs = (
        ParameterSpec("change_of_viscous", "N m s/rad", "viscous friction less the nominal one"),
        ParameterSpec("change_of_coulomb", "N m", "Coulomb friction less the nominal one"),
    )

    def variants(self, space: ParameterSpace, joint: int | None) -> list[list[Change]]:
        """Both together."""
        assert joint is not None
        changes = [
            change for kind, name in _NAMES.items() for change in space.change(kind, joint, name)
        ]
        return [changes] if changes else []

    def base_parameters(self, space: ParameterSpace, joint: int) -> list[Change]:
        """Both."""
        return [change for kind, name in _NAMES.items() for change in space.base(kind, joint, name)]

    def admissible(
        self, space: ParameterSpace, joint: int | None, found: Sequence[Estimated]
    ) -> bool:
        """Friction does not become negative."""
        assert joint is not None
        given = space.model.robot.given
        levels = {"Fv": given.viscous[joint], "Fc": given.coulomb[joint]}
        names = {name: kind for kind, name in _NAMES.items()}
        return not any(
            each.above(-float(levels[names[each.change.name]])) is False for each in found
        )
