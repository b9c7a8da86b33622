"""The catalogue: which effects the diagnosis looks for."""

from idim_iv_ros.gap.effects.asymmetric_friction import AsymmetricFriction
from idim_iv_ros.gap.effects.backlash import Backlash
from idim_iv_ros.gap.effects.drive_inertia import DriveInertia
from idim_iv_ros.gap.effects.effect import Effect
from idim_iv_ros.gap.effects.elasticity import Elasticity
from idim_iv_ros.gap.effects.encoder_eccentricity import EncoderEccentricity
from idim_iv_ros.gap.effects.friction_drift import FrictionDrift
from idim_iv_ros.gap.effects.friction_level import FrictionLevel
from idim_iv_ros.gap.effects.gravity_direction import GravityDirection
from idim_iv_ros.gap.effects.joint_coupling import JointCoupling
from idim_iv_ros.gap.effects.link_inertia import LinkInertia
from idim_iv_ros.gap.effects.load_dependent_friction import LoadDependentFriction
from idim_iv_ros.gap.effects.nonlinear_viscous import NonlinearViscous
from idim_iv_ros.gap.effects.parametric_effect import ParametricEffect
from idim_iv_ros.gap.effects.payload import Payload
from idim_iv_ros.gap.effects.position_dependent_friction import PositionDependentFriction
from idim_iv_ros.gap.effects.position_ripple import PositionRipple
from idim_iv_ros.gap.effects.presliding import Presliding
from idim_iv_ros.gap.effects.spring import Spring
from idim_iv_ros.gap.effects.stribeck import Stribeck
from idim_iv_ros.gap.effects.time_delay import TimeDelay
from idim_iv_ros.gap.effects.torque_gain import TorqueGain
from idim_iv_ros.gap.effects.torque_saturation import TorqueSaturation

# Where two explain the change alike, the first counts.
PARAMETRIC: tuple[ParametricEffect, ...] = (
    Payload(),
    GravityDirection(),
    TorqueGain(),
    FrictionLevel(),
    DriveInertia(),
    LinkInertia(),
)

STRUCTURAL: tuple[Effect, ...] = (
    Stribeck(),
    NonlinearViscous(),
    AsymmetricFriction(),
    LoadDependentFriction(),
    PositionDependentFriction(),
    FrictionDrift(),
    Presliding(),
    Backlash(),
    Elasticity(),
    TimeDelay(),
    TorqueSaturation(),
    PositionRipple(),
    Spring(),
    EncoderEccentricity(),
    JointCoupling(),
)

# Every name that a cause may have, parametric ones first.
EFFECTS: tuple[str, ...] = (
    "payload",
    "link_inertia",
    "gravity_direction",
    "torque_gain",
    "friction_level",
    "drive_inertia",
    *(effect.name for effect in STRUCTURAL),
    "controller_mismatch",
)
