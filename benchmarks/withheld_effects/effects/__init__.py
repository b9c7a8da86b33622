"""Effects by name: each draws its own shape from random numbers."""

from benchmarks.withheld_effects.effects import (
    actuation,
    friction,
    outside,
    parametric,
    transmission,
)
from benchmarks.withheld_effects.effects.effect import Draw, Effect


def _named(*draws: Draw) -> dict[str, Draw]:
    return {draw.__name__: draw for draw in draws}


STRUCTURAL = _named(
    friction.stribeck,
    friction.nonlinear_viscous,
    friction.asymmetric_friction,
    friction.load_dependent_friction,
    friction.position_dependent_friction,
    friction.friction_drift,
    friction.presliding,
    transmission.backlash,
    transmission.elasticity,
    actuation.time_delay,
    actuation.torque_saturation,
    transmission.position_ripple,
    transmission.spring,
    transmission.encoder_eccentricity,
    transmission.encoder_offset,
    transmission.joint_coupling,
    actuation.controller_mismatch,
)
PARAMETRIC = _named(
    parametric.payload,
    parametric.link_inertia,
    parametric.gravity_direction,
    parametric.torque_gain,
    parametric.friction_level,
    parametric.drive_inertia,
)
OUTSIDE = _named(
    outside.contact_pulses,
    outside.one_sided_stop,
    outside.random_bursts,
    outside.sensor_dropout,
)
# Other forms of effects above: their name is that of the effect.
VARIANTS = _named(
    friction.static_load_friction,
    friction.friction_drift_anew,
    actuation.common_delay,
)
EFFECTS = {**STRUCTURAL, **VARIANTS, **PARAMETRIC, **OUTSIDE}

__all__ = ["EFFECTS", "OUTSIDE", "PARAMETRIC", "STRUCTURAL", "VARIANTS", "Draw", "Effect"]
