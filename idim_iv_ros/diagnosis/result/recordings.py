"""Properties of the recordings: signal chain, transmission, agreement with one another."""

from dataclasses import dataclass

from idim_iv_ros.documents import Number
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class SignalChain:
    """What lies between the law and the torque: a property of the recording, and no cause.

    Attributes
    ----------
    effort_shift : EffectParameter
        Time from the recorded effort to the torque on the joints, s; it was taken out before causes
        were looked for. Zero with `std` None where none can be said.
    periods : float
        The same in periods of the control.
    joint_shifts : dict of joint to EffectParameter
        Each joint's own, s.
    differing : tuple of str
        Joints that do not share the common shift.
    law_speed : str or None
        The speed with which the configured law explains the commands best, in words; None where
        the commands cannot be compared with a law.
    """

    effort_shift: EffectParameter
    periods: float
    joint_shifts: dict[str, EffectParameter]
    differing: tuple[str, ...]
    law_speed: str | None


@dataclass(frozen=True, kw_only=True)
class Transmission:
    """What encoders before and behind a gear say of it: motor less link, beside the load.

    Attributes
    ----------
    joint : str
    stiffness : EffectParameter or None
        N m/rad (N/m); None where `reason` says why.
    stiffness_at_least : float or None
        Lower end of its 95 % interval.
    damping : EffectParameter or None
        N m s/rad; None where none shows.
    backlash : EffectParameter or None
        Gap of the play, rad: the hysteresis over the load's sign beyond the linear law; None where
        none shows.
    backlash_at_most : float or None
        Upper end of its 95 % interval, rad; None where the load never changes its side.
    lost_motion : EffectParameter or None
        Hysteresis over the direction of motion, rad: play that friction keeps on one side, or
        friction behind the gear.
    time_offset : EffectParameter or None
        Time by which the link's channel is late, s. No elasticity.
    position_error : bool
        Whether the twist also follows the position: an error of one of the encoders.
    explained : float
        Share of the twist's variance, position aside, that is explained, 0 to 1.
    elastic_share : float
        Share that follows the load in proportion.
    twist_rms : float
        rad, with both channels at the same instants, less constants and position.
    resolution : float
        Step of the coarser encoder, rad; zero where none shows.
    rows : int
    tests : tuple of HypothesisTest
        Whether one stiffness holds throughout.
    unit : str
        Of the twist.
    reason : str
        Why no stiffness can be said; empty where one is.
    """

    joint: str
    stiffness: EffectParameter | None = None
    stiffness_at_least: float | None = None
    damping: EffectParameter | None = None
    backlash: EffectParameter | None = None
    backlash_at_most: float | None = None
    lost_motion: EffectParameter | None = None
    time_offset: EffectParameter | None = None
    position_error: bool = False
    explained: Number = 0.0
    elastic_share: Number = 0.0
    twist_rms: Number = 0.0
    resolution: Number = 0.0
    rows: int = 0
    tests: tuple[HypothesisTest, ...] = ()
    unit: str = "rad"
    reason: str = ""


@dataclass(frozen=True)
class TransmissionSeries:
    """Twist over load of one joint, less time offset, position and constants; (r,) each.

    Attributes
    ----------
    joint : str
    load : N m
    twist : rad
    direction : −1 to 1
    """

    joint: str
    load: FloatArray
    twist: FloatArray
    direction: FloatArray


@dataclass(frozen=True)
class Difference:
    """A parametric cause by which one recording differs from the others: theirs is the nominal."""

    effect: str
    joint: str | None
    parameters: dict[str, EffectParameter]


@dataclass(frozen=True)
class RecordingAgreement:
    """Whether the parameters of the other recordings hold for this one.

    Attributes
    ----------
    bag : str
    agrees : bool
    joint : str
        Where it differs most.
    share_of_torque : float
        Torque of the difference there, as a share of the joint's (rms); zero where it agrees.
    differences : tuple of Difference
        What differs; empty where it agrees.
    """

    bag: str
    agrees: bool
    joint: str
    share_of_torque: Number
    differences: tuple[Difference, ...] = ()
