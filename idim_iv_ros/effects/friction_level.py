"""Viscous and Coulomb friction that are not the nominal ones: age, temperature, another grease."""

from idim_iv_ros.effects.cause import ParameterSpec
from idim_iv_ros.effects.parametric_effect import ParametricEffect


class FrictionLevel(ParametricEffect):
    """Changes of both friction parameters of one joint."""

    name = "friction_level"
    order = 40
    part = "friction"
    excitation = "slow and fast motion in both directions"
    segments = ("plateau",)
    specs = (
        ParameterSpec(
            "change_of_viscous", "N m s/rad", "change of viscous friction", standard="Fv"
        ),
        ParameterSpec("change_of_coulomb", "N m", "change of Coulomb friction", standard="Fc"),
    )
