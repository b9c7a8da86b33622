"""The document gap.json: where the gap lies, the stages, and the series that its report draws."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from idim_iv_ros.diagnosis.result.causes import Cause, Hint, ParameterError, Unexplained
from idim_iv_ros.diagnosis.result.recordings import (
    ContrastResult,
    RecordingAgreement,
    SignalChain,
    Transmission,
    TransmissionSeries,
)
from idim_iv_ros.documents import Document, HighEnd, LowEnd, Number, Unsaved
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.files import GAP_FORMAT
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.recording.recording import SessionPart
from idim_iv_ros.statistics.residuals import beyond_noise
from idim_iv_ros.types import FloatArray

Verdict = Literal["none", "parametric", "structural", "both", "unknown"]


@dataclass(frozen=True)
class JointGap:
    """The gap of the nominal model at one joint.

    - `rms`: N m (N), of the nominal model (of the refit where no model is given)
    - `relative_percent`: 100 ‖y − X β₀‖ / ‖y‖
    - `share`: of the whole gap beyond noise, each joint's energy divided by that of its torque, 0
      to 1
    - `noise_floor`: N m (N)
    - `floor_origin`: ``repeats`` or ``lower bound``, in words for the report
    """

    joint: str
    rms: float
    relative_percent: float | None
    share: Number
    noise_floor: float | None
    floor_origin: str

    @property
    def beyond_noise_percent(self) -> float | None:
        """The part of `relative_percent` beyond the noise floor, all of it where none is known."""
        if self.relative_percent is None or self.noise_floor is None:
            return self.relative_percent
        return beyond_noise(self.relative_percent, self.rms, self.noise_floor)


@dataclass(frozen=True)
class Regime:
    """Part of one joint's samples.

    - `axis`: ``speed``, ``direction``, ``position``, ``load``, ``time`` or ``reversal`` (distance
      since the last one)
    - `low`, `high`: of the axis, in `unit`; infinite where the end is open
    - `energy_share`, `occupancy`: share of the joint's gap energy, and of its samples, 0 to 1
    - `lift`: energy_share / occupancy
    - `ci95`: of the lift, by a bootstrap over blocks of time
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

    - `name`: ``given``, ``refit``, ``+stribeck[joint_1]`` …
    - `torque_rms`: on data not used to fit, N m (N)
    - `tracking_rms`: difference between the simulated and the recorded motion, rad (m); None where
      the loop cannot be simulated or diverges
    - `note`: why something is missing; empty otherwise
    """

    name: Annotated[str, Field(alias="stage")]
    torque_rms: dict[str, Number]
    torque_ci95: dict[str, tuple[Number, Number]]
    tracking_rms: dict[str, Number] | None
    note: str


@dataclass(frozen=True)
class GapSeries:
    """Rows of one joint over all recordings, for the figures; (r,) each, torques in N m (N)."""

    joint: str
    time: FloatArray  # of the session, s, which increases
    torque: FloatArray  # measured
    given: FloatArray | None  # of the nominal model; None without one
    refit: FloatArray
    extended: FloatArray
    friction: FloatArray  # friction and offset of the extended model
    given_friction: FloatArray | None  # and of the nominal one
    position: FloatArray
    speed: FloatArray
    load: FloatArray  # torque of the rigid bodies alone
    since_reversal: FloatArray  # distance since the last one, rad
    step: float  # between two rows, s


@dataclass(frozen=True)
class TrackingSeries:
    """Tracking error of one joint in one recording, thinned for the figures; (s,) each, rad."""

    joint: str
    bag: str
    time: FloatArray
    measured: FloatArray
    before: FloatArray | None
    after: FloatArray | None


@dataclass(frozen=True, kw_only=True)
class GapResult(Document):
    """Outcome of a diagnosis: gap.json, and what its report draws.

    - `session`: where each recording lies in the time of the session, in the order of `bags`
    - `without`: effects that were left out of the catalogue
    - `summary`: one paragraph that a robot engineer can act on
    - `causes`: strongest first
    - `left_out`: joints whose recorded torque says nothing of the robot, and why
    - `hints`: no causes: they count for no verdict and are not handed on to a simulator
    - `parameter_errors`: one for each joint; empty without a nominal model
    - `friction_leads`: s by which dry friction turns before its joint, as a simulator's solver
      softens it; only joints where it does
    - `recordings`: in the order of `bags`; empty of a single recording
    - `contrast`: what changed in a second set of recordings; all else is of the reference set,
      `bags`
    - `transmissions`: one for each joint with an encoder behind its gear
    - `findings`: the top regimes in words
    - `notes`: what could not be done and why
    - `extended_parameters`: base parameters of the extended model
    - `physical`, `why_no_physical`: nearest to the base parameters of the extended model; why there
      are none
    - `kinematics`: digest of the geometry (`kinematics_digest`): to which URDF the result belongs
    - `timing`: seconds by stage
    - `series`, `tracking`, `twists`: for the report and not in the document
    """

    what: ClassVar[str] = "a diagnosis"
    written_by: ClassVar[str] = "diagnose"

    format: Literal["idim_iv_ros/gap/1"] = GAP_FORMAT
    robot: str
    joints: tuple[str, ...]
    joint_types: tuple[str, ...]
    bags: tuple[str, ...]
    session: tuple[SessionPart, ...] = ()
    software: dict[str, str]
    without: tuple[str, ...]
    verdict: Verdict
    summary: str
    left_out: dict[str, str] = field(default_factory=dict)
    causes: tuple[Cause, ...]
    hints: tuple[Hint, ...] = ()
    unexplained: Unexplained | None
    parameter_errors: tuple[ParameterError, ...] = ()
    signal_chain: SignalChain | None = None
    friction_leads: dict[str, Number] = field(default_factory=dict)
    recordings: tuple[RecordingAgreement, ...] = ()
    contrast: ContrastResult | None = None
    transmissions: tuple[Transmission, ...] = ()
    where: Where
    findings: tuple[str, ...]
    not_testable: tuple[NotTestable, ...]
    stages: tuple[Stage, ...]
    notes: tuple[str, ...]
    extended_parameters: dict[str, EffectParameter]
    configuration: dict[str, object]
    physical: PhysicalParameters | None = None
    why_no_physical: str = ""
    kinematics: str = ""
    timing: dict[str, Number] = field(default_factory=dict)
    series: Unsaved[tuple[GapSeries, ...]] = field(default=(), compare=False)
    tracking: Unsaved[tuple[TrackingSeries, ...]] = field(default=(), compare=False)
    twists: Unsaved[tuple[TransmissionSeries, ...]] = field(default=(), compare=False)

    @property
    def summary_of_reference(self) -> str:
        """The summary of the recordings by themselves, without what changed in a second set."""
        if self.contrast is None:
            return self.summary
        return self.summary.removeprefix(self.contrast.sentence).strip()

    @property
    def recorded(self) -> float | None:
        """Length of all recordings together, without the pauses, s; None where not known."""
        return sum(part.duration for part in self.session) if self.session else None
