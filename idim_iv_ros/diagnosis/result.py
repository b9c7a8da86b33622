"""What a diagnosis found: the document gap.json, what it consists of, and what its report draws."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from idim_iv_ros.documents import Document, HighEnd, LowEnd, Number, Unsaved
from idim_iv_ros.effects.cause import EffectParameter, Family, Kind
from idim_iv_ros.files import GAP_FORMAT
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.recording.recording import SessionPart
from idim_iv_ros.statistics.residuals import beyond_noise
from idim_iv_ros.types import FloatArray

LEAST_ROOM = 1e-3  # of a gap, above the noise floor, for a shrinkage to be said

Verdict = Literal["none", "parametric", "structural", "both", "unknown"]


@dataclass(frozen=True)
class Evidence:
    """Why an effect is believed.

    - `statistic`: twice the logarithm of the likelihood ratio, of whitened residuals, with and
      without (structural); Wald statistic of the change of the parameters (parametric)
    - `held_out_gain`: share of the energy of the whitened residual that the effect removes, on
      blocks not used to fit; None where there are no such blocks
    - `folds_positive`: on how many of the held-out blocks the effect helps: ``5 of 6``
    - `chosen_in_folds`: without how many of the folds a search names it again: ``5 of 5``; empty of
      causes that no search selects
    """

    statistic: Number
    held_out_gain: float | None = None
    folds_positive: str = ""
    chosen_in_folds: str = ""


@dataclass(frozen=True)
class Indistinguishable:
    """An effect that explains the recording nearly as well as the accepted one.

    `weight`: its share of the probability of the whole set, 0 to 1.
    """

    effect: str
    joint: str | None
    weight: Number


@dataclass(frozen=True)
class Gap:
    """A gap before and after one step, on data not used to fit.

    - `before`, `after`: RMS, N m or rad (N, m for a prismatic joint)
    - `noise_floor`: RMS that no model can pass; None where it is unknown
    - `shrinkage`: share of the part above the noise floor that goes: (before − after) / (before −
      floor); where the floor is unknown, 1 − after / before
    - `ci95`: of the shrinkage, by a bootstrap over blocks of time
    """

    before: Number
    after: Number
    noise_floor: float | None = None
    shrinkage: float | None = None
    ci95: tuple[Number, Number] | None = None

    @classmethod
    def between(cls, before: float, after: float, floor: float | None = None) -> "Gap":
        """Return one with its shrinkage, where anything is above the noise floor."""
        room = before - (floor or 0.0)
        shrinkage = (before - after) / room if room > LEAST_ROOM * before else None
        return cls(before, after, floor, shrinkage)


@dataclass(frozen=True)
class SimulationGap(Gap):
    """A tracking error before and after; nothing says which part of it is noise."""

    noise_floor: Annotated[None, Field(exclude=True)] = None


@dataclass(frozen=True)
class JointChange:
    """What one cause takes of the torque gap at one joint.

    - `before`, `after`: RMS of the torque gap, beside the causes before it, N m (N)
    - `share_of_torque`: root of before² − after², as a share of the joint's torque (rms); negative
      where the gap grows
    """

    joint: str
    before: Number
    after: Number
    share_of_torque: Number


@dataclass(frozen=True)
class ParameterError:
    """What parameter errors make of the nominal model's torque gap at one joint, rms, N m (N).

    - `given`: of the nominal model
    - `named`: with the parametric causes that are listed
    - `refit`: with new base parameters
    - `remaining`: root of named² − refit²: the parameter error that no listed cause accounts for
    - `share_of_torque`: of that, as a share of the joint's torque (rms)
    """

    joint: str
    given: Number
    named: Number
    refit: Number
    remaining: Number
    share_of_torque: Number


@dataclass(frozen=True, kw_only=True)
class Attribution:
    """An effect at its place with its numbers: what causes, hints and changes have in common.

    - `effect`: name in the catalogue
    - `joint`, `other_joint`: None where it belongs to no joint; the second joint is that of a
      coupling
    - `sentence`: what a robot engineer should read: where, what, how large, how far the gap
      shrinks; of a hint why it is no cause
    """

    effect: str
    joint: str | None
    other_joint: str | None = None
    sentence: str
    parameters: dict[str, EffectParameter]


@dataclass(frozen=True, kw_only=True)
class Cause(Attribution):
    """One accepted cause of the gap.

    - `torque_gap`: at the joint; over all joints where it belongs to none
    - `joint_gaps`: joints whose torque gap it changes noticeably, its own first
    - `simulation_gap`: tracking error of the simulated closed loop against the recorded one; None
      where the loop cannot be simulated
    - `probability`: that it is a cause, 0 to 1, calibrated on simulated recordings
      (`comparison.probability`); None of what other rows than the torque's show, which nothing was
      calibrated for
    """

    kind: Kind
    evidence: Evidence
    indistinguishable_from: tuple[Indistinguishable, ...] = ()
    torque_gap: Gap
    joint_gaps: tuple[JointChange, ...] = ()
    simulation_gap: SimulationGap | None = None
    probability: float | None = None


@dataclass(frozen=True, kw_only=True)
class Hint(Attribution):
    """What a search over all data finds, and what is not sure enough for a cause.

    An effect that does not hold without the data that chose it, or a parameter error each of whose
    numbers may be zero beside errors of all other given numbers.

    - `reason`: why it is no cause
    - `probability`: that it, or what the recording cannot tell from it, is a cause, 0 to 1,
      calibrated; None where something else speaks against it
    - `chosen_in_folds`: without how many of the folds a search names it again: ``2 of 5``; empty
      for a parameter error
    - `torque_gap`: at the joint, on data that did not choose it; of a parameter error, by itself
      and on all data
    """

    joint: str
    reason: str
    chosen_in_folds: str
    torque_gap: Gap
    probability: float | None = None


@dataclass(frozen=True)
class Unexplained:
    """What no effect of the catalogue explains.

    `share`: of the energy of the whitened residual at that joint, 0 to 1: what the nonparametric
    alternative takes off that of the refit; of events, what the largest 1 % of the samples hold.
    """

    joint: str
    family: Family
    share: Number
    where: str

    def likeliest(self, hints: Sequence[Hint]) -> Hint | None:
        """Return the likeliest effect of the catalogue that it may be; None where there is none."""
        there = [
            hint for hint in hints if hint.joint == self.joint and hint.probability is not None
        ]
        return max(there, key=lambda hint: hint.probability or 0.0, default=None)


@dataclass(frozen=True)
class SignalChain:
    """What lies between the law and the torque: a property of the recording, and no cause.

    - `effort_shift`: time from the recorded effort to the torque on the joints, s; it was taken out
      before causes were looked for. Zero with `std` None where none can be said
    - `periods`: the same in periods of the control
    - `joint_shifts`: each joint's own, s
    - `differing`: joints that do not share the common shift
    - `law_speed`: the speed with which the configured law explains the commands best, in words;
      None where the commands cannot be compared with a law
    """

    effort_shift: EffectParameter
    periods: float
    joint_shifts: dict[str, EffectParameter]
    differing: tuple[str, ...]
    law_speed: str | None


@dataclass(frozen=True, kw_only=True)
class Transmission:
    """What encoders before and behind a gear say of it: motor less link, beside the load.

    - `stiffness`, `stiffness_at_least`: N m/rad (N/m), None where `reason` says why; and the lower
      end of its 95 % interval
    - `damping`: N m s/rad; None where none shows
    - `backlash`: gap of the play, rad: the hysteresis over the load's sign beyond the linear law;
      None where none shows
    - `backlash_at_most`: upper end of its 95 % interval, rad; None where the load never changes its
      side
    - `lost_motion`: hysteresis over the direction of motion, rad: play that friction keeps on one
      side, or friction behind the gear
    - `time_offset`: time by which the link's channel is late, s. No elasticity
    - `position_error`: whether the twist also follows the position: an error of one of the encoders
    - `elastic_share`: share of the twist's variance, position aside, that follows the load in
      proportion, 0 to 1
    - `resolution`: step of the coarser encoder, rad; zero where none shows
    - `unit`: of the twist
    - `reason`: why no stiffness can be said; empty where one is
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
    elastic_share: Number = 0.0
    resolution: Number = 0.0
    rows: int = 0
    unit: str = "rad"
    reason: str = ""


@dataclass(frozen=True)
class TransmissionSeries:
    """Twist over load of one joint, less time offset, position and constants.

    (r,) each: load in N m, twist in rad, and the direction of motion, −1 to 1.
    """

    joint: str
    load: FloatArray
    twist: FloatArray
    direction: FloatArray


@dataclass(frozen=True)
class Difference:
    """A cause by which one recording differs from the others: theirs is the nominal."""

    effect: str
    joint: str | None
    parameters: dict[str, EffectParameter]


@dataclass(frozen=True)
class RecordingAgreement:
    """Whether the parameters of the other recordings hold for this one.

    - `joint`: where it differs most
    - `share_of_torque`: torque of the difference there, as a share of the joint's (rms); zero where
      it agrees
    - `differences`: what differs; empty where it agrees
    """

    bag: str
    agrees: bool
    joint: str
    share_of_torque: Number
    differences: tuple[Difference, ...] = ()


@dataclass(frozen=True)
class JointTorque:
    """Torque that a difference makes at one joint in the second set: rms, N m (N), and share."""

    joint: str
    rms: Number
    share_of_torque: Number


@dataclass(frozen=True)
class JointContrast:
    """How far two sets of recordings differ at one joint, rms in the second set, N m (N).

    - `before`: of the model of the reference set, which the second set was not used to fit
    - `after`: with the causes that are listed
    - `own`: with numbers of its own besides, in each quarter of a recording as the others have them
    - `share_of_torque`: root of before² − own², as a share of the joint's torque (rms): by how much
      the sets differ
    - `unexplained`: root of after² − own², N m (N): what no listed cause accounts for
    """

    joint: str
    before: Number
    after: Number
    own: Number
    share_of_torque: Number
    unexplained: Number


@dataclass(frozen=True, kw_only=True)
class ContrastCause(Attribution):
    """One thing that changed between two sets of recordings.

    Its parameters are second set less reference; of an effect that one set alone has, its numbers
    there.

    - `change`: ``appeared`` and ``vanished`` where one set alone has the effect, else ``changed``
    - `bags`: recordings of the second set that it holds for
    - `reference`, `against`: the numbers in each set, where they are known one by one
    - `torques`: joints where it matters, its own first
    """

    kind: Kind
    change: Literal["appeared", "vanished", "changed"]
    bags: tuple[str, ...]
    reference: dict[str, EffectParameter] = field(default_factory=dict)
    against: dict[str, EffectParameter] = field(default_factory=dict)
    evidence: Evidence
    indistinguishable_from: tuple[Indistinguishable, ...] = ()
    torques: tuple[JointTorque, ...] = ()


@dataclass(frozen=True, kw_only=True)
class ContrastResult:
    """What changed between a reference set of recordings and a second one.

    - `reference`, `against`: recordings
    - `differs`: null where no difference was seen and some joint could not be compared
    - `sentence`: the answer, in words
    - `causes`: strongest first; empty where the sets do not differ, or where nothing explains it
    - `joints`: those that were compared; `not_compared`: the others, in words, and why
    - `unattributed`, `common`: differences outside the catalogue, and effects that both sets share,
      in words
    - `effort_shift`: time from the recorded effort to the torque, s, of ``reference`` and
      ``against``
    - `notes`: what could not be compared and why
    """

    reference: tuple[str, ...]
    against: tuple[str, ...]
    differs: bool | None
    sentence: str
    joints: tuple[JointContrast, ...]
    causes: tuple[ContrastCause, ...]
    not_compared: tuple[str, ...] = ()
    unattributed: tuple[str, ...] = ()
    common: tuple[str, ...] = ()
    effort_shift: dict[str, EffectParameter] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


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
    """Rows of one joint over all recordings, for the figures; (r,) each.

    `time`: of the session, s, which increases; `torque`, `given`, `refit`, `extended`: measured,
    and of three models, N m (N); `given` is None without a nominal model; `friction`,
    `given_friction`: friction and offset of the extended and of the nominal model; `load`: torque
    of the rigid bodies alone; `since_reversal`: distance since the last one, rad; `step`: between
    two rows, s.
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
