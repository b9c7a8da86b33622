"""Where the gap lies, what the recording cannot test, and the stages from the nominal model on."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from idim_iv_ros.documents import HighEnd, LowEnd, Number
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class JointGap:
    """The gap of the nominal model at one joint.

    Attributes
    ----------
    joint : str
    rms : float
        N m (N), of the nominal model (of the refit where no model is given).
    relative_percent : float or None
        100 ‖y − X β₀‖ / ‖y‖.
    share : float
        Of the whole gap, each joint's energy divided by that of its torque, 0 to 1.
    noise_floor : float or None
        N m (N).
    floor_origin : str
        ``repeats`` or ``lower bound``, in words for the report.
    """

    joint: str
    rms: float
    relative_percent: float | None
    share: Number
    noise_floor: float | None
    floor_origin: str


@dataclass(frozen=True)
class Regime:
    """Part of one joint's samples.

    Attributes
    ----------
    joint : str
    axis : str
        ``speed``, ``direction``, ``position``, ``load``, ``time``, ``reversal`` (distance since
        the last one) or ``frequency``.
    low, high : float
        Of the axis, in `unit`; infinite where the end is open.
    unit : str
    energy_share, occupancy : float
        Share of the joint's gap energy, and of its samples, 0 to 1.
    lift : float
        energy_share / occupancy.
    ci95 : (low, high) or None
        Of the lift, by a bootstrap over blocks of time.
    """

    joint: str
    axis: str
    low: LowEnd
    high: HighEnd
    unit: str
    energy_share: Number
    occupancy: Number
    lift: Number
    ci95: tuple[Number, Number] | None


@dataclass(frozen=True)
class Where:
    """Where the gap lies: joint by joint, and the regimes, largest lift first."""

    joints: tuple[JointGap, ...]
    regimes: tuple[Regime, ...]


@dataclass(frozen=True)
class NotTestable:
    """An effect that this recording cannot show.

    `smallest` says, in words with its unit, the smallest size that would be seen; empty where no
    size would.
    """

    effect: str
    joint: str | None
    reason: str
    excitation_needed: str
    smallest: str = ""


@dataclass(frozen=True)
class Stage:
    """One model on the way from the nominal to the extended one.

    Attributes
    ----------
    name : str
        ``given``, ``refit``, ``+stribeck[joint_1]`` …
    torque_rms : dict of joint to float
        On data not used to fit, N m (N).
    torque_ci95 : dict of joint to (low, high)
    tracking_rms : dict of joint to float, or None
        Difference between the simulated and the recorded motion, rad (m); None where the loop
        cannot be simulated or diverges.
    note : str
        Why something is missing; empty otherwise.
    """

    name: Annotated[str, Field(alias="stage")]
    torque_rms: dict[str, Number]
    torque_ci95: dict[str, tuple[Number, Number]]
    tracking_rms: dict[str, Number] | None
    note: str


@dataclass(frozen=True)
class GapSeries:
    """Rows of one joint over all recordings, for the figures; (r,) each.

    Attributes
    ----------
    joint : str
    time : s
        Of the session (`recording.session`): it increases.
    torque, given, refit, extended : N m (N)
        Measured, and of three models; `given` is None without a nominal model.
    friction, given_friction : N m (N)
        Friction and offset of the extended and of the nominal model; `given_friction` is None
        without one.
    position, speed : rad, rad/s
    load : N m
        Torque of the rigid bodies alone.
    since_reversal : rad
        Distance since the last reversal.
    step : s
        Between two rows.
    """

    joint: str
    time: FloatArray
    torque: FloatArray
    given: FloatArray | None
    refit: FloatArray
    extended: FloatArray
    friction: FloatArray
    given_friction: FloatArray | None
    position: FloatArray
    speed: FloatArray
    load: FloatArray
    since_reversal: FloatArray
    step: float
