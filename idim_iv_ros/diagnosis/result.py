"""What a diagnosis found: the document gap.json, and the series that its report draws."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from idim_iv_ros.documents import Document, HighEnd, LowEnd, Number, Unsaved
from idim_iv_ros.effects.cause import EffectParameter as EffectParameter
from idim_iv_ros.effects.cause import Family, Kind
from idim_iv_ros.files import GAP_FORMAT
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.recording import SessionPart
from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.types import FloatArray

Verdict = Literal["none", "parametric", "structural", "both", "unknown"]


# Tests of parameters hold for a model without any other error: their p-values would be too small.
NOT_CALIBRATED = "none: no recordings were simulated from a model without this cause"


@dataclass(frozen=True)
class Evidence:
    """Why an effect is believed.

    Attributes
    ----------
    statistic : float
        Twice the logarithm of the likelihood ratio, of whitened residuals, with and without
        (structural); Wald statistic of the change of the parameters (parametric).
    p_value : float or None
        Of the choice among all candidates: how often the best of them does as well on recordings
        that are simulated from the model without the effect and its own noise. None where that
        was not done.
    held_out_gain : float or None
        Share of the energy of the whitened residual that the effect removes, on blocks not used to
        fit; None where there are no such blocks.
    folds_positive : str
        On how many of the held-out blocks the effect helps: ``5 of 6``.
    chosen_in_folds : str
        Without how many of the folds a search names it again: ``5 of 5``; empty of causes that
        no search selects.
    p_value_from : str
        What the p-value was calibrated on and the least that it can be, or why there is none.
    """

    statistic: Number
    p_value: float | None
    held_out_gain: float | None
    folds_positive: str
    chosen_in_folds: str = ""
    p_value_from: str = ""


@dataclass(frozen=True)
class Indistinguishable:
    """An effect that explains the recording as well as the accepted one.

    `correlation`: of the torques that both would add, less what the model absorbs, 0 to 1.
    """

    effect: str
    joint: str | None
    correlation: Number


@dataclass(frozen=True)
class Gap:
    """A gap before and after one step, on data not used to fit.

    Attributes
    ----------
    before, after : float
        RMS, N m or rad (N, m for a prismatic joint).
    noise_floor : float or None
        RMS that no model can pass; None where it is unknown.
    shrinkage : float or None
        Share of the part above the noise floor that goes: (before − after) / (before − floor);
        where the floor is unknown, 1 − after / before.
    ci95 : (low, high) or None
        Of the shrinkage, by a bootstrap over blocks of time.
    """

    before: Number
    after: Number
    noise_floor: float | None
    shrinkage: float | None
    ci95: tuple[Number, Number] | None


@dataclass(frozen=True)
class SimulationGap(Gap):
    """A tracking error before and after; nothing says which part of it is noise."""

    noise_floor: Annotated[None, Field(exclude=True)] = None
    shrinkage: float | None = None
    ci95: tuple[Number, Number] | None = None


@dataclass(frozen=True)
class JointChange:
    """What one cause takes of the torque gap at one joint.

    Attributes
    ----------
    joint : str
    before, after : float
        RMS of the torque gap, beside the causes before it, N m (N).
    share_of_torque : float
        Root of before² − after², as a share of the joint's torque (rms); negative where the gap
        grows.
    """

    joint: str
    before: Number
    after: Number
    share_of_torque: Number


@dataclass(frozen=True)
class ParameterError:
    """What parameter errors make of the nominal model's torque gap at one joint, rms, N m (N).

    Attributes
    ----------
    joint : str
    given : float
        Of the nominal model.
    named : float
        With the parametric causes that are listed.
    refit : float
        With new base parameters.
    remaining : float
        Root of named² − refit²: the parameter error that no listed cause accounts for.
    share_of_torque : float
        Of that, as a share of the joint's torque (rms).
    """

    joint: str
    given: Number
    named: Number
    refit: Number
    remaining: Number
    share_of_torque: Number


@dataclass(frozen=True, kw_only=True)
class Cause:
    """One accepted cause of the gap.

    Attributes
    ----------
    effect : str
        Name in the catalogue.
    kind : str
    joint : str or None
        None where the cause belongs to no joint.
    other_joint : str or None
        The second joint of a coupling.
    sentence : str
        What a robot engineer should read: where, what, how large, how far the gap shrinks.
    parameters : dict of str to EffectParameter
    evidence : Evidence
    indistinguishable_from : tuple of Indistinguishable
    torque_gap : Gap
        At the joint; over all joints where it belongs to none.
    joint_gaps : tuple of JointChange
        Joints whose torque gap it changes noticeably, its own first.
    simulation_gap : SimulationGap or None
        Tracking error of the simulated closed loop against the recorded one; None where the
        loop cannot be simulated.
    """

    effect: str
    kind: Kind
    joint: str | None
    other_joint: str | None
    sentence: str
    parameters: dict[str, EffectParameter]
    evidence: Evidence
    indistinguishable_from: tuple[Indistinguishable, ...]
    torque_gap: Gap
    joint_gaps: tuple[JointChange, ...] = ()
    simulation_gap: SimulationGap | None


@dataclass(frozen=True, kw_only=True)
class Hint:
    """What a search over all data finds, and what does not hold without the data that chose it.

    Attributes
    ----------
    effect : str
    joint : str
    other_joint : str or None
    sentence : str
        What it would be, and why it is only a hint.
    reason : str
        The second half of that.
    parameters : dict of str to EffectParameter
        If it were a cause.
    chosen_in_folds : str
        Without how many of the folds a search names it again: ``2 of 5``.
    torque_gap : Gap
        At the joint, on data that did not choose it.
    """

    effect: str
    joint: str
    other_joint: str | None
    sentence: str
    reason: str
    parameters: dict[str, EffectParameter]
    chosen_in_folds: str
    torque_gap: Gap


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
class Confusability:
    """Which candidates this recording confuses, from the motion alone.

    Attributes
    ----------
    joint : str
    effects : tuple of str
    correlation : (n, n)
        Largest canonical correlation of what the model does not absorb.
    absorbed : (n,)
        Share of each candidate's energy that the model absorbs.
    smallest : tuple of str
        Smallest size that would be seen, in words with its unit.
    """

    joint: str
    effects: tuple[str, ...]
    correlation: FloatArray
    absorbed: FloatArray
    smallest: tuple[str, ...]


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
    position: FloatArray
    speed: FloatArray
    load: FloatArray
    since_reversal: FloatArray
    step: float


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
    test : HypothesisTest
        F test of H0: one set of base parameters holds for it and the others.
    joint : str
        Where it differs most.
    share_of_torque : float
        How much there, on blocks of time that were not fitted, as a share of the torque (rms).
    differences : tuple of Difference
        What differs; empty where it agrees, or where nothing of the catalogue explains it.
    """

    bag: str
    agrees: bool
    test: HypothesisTest
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

    Attributes
    ----------
    joint : str
    before : float
        Of the model of the reference set, which the second set was not used to fit.
    after : float
        With the causes that are listed, on blocks of time that were not used to fit.
    own : float
        With parameters and effects of its own, likewise.
    share_of_torque : float
        Root of before² − own², as a share of the joint's torque (rms): by how much the sets differ.
    unexplained : float
        Root of after² − own², N m (N): what no listed cause accounts for.
    """

    joint: str
    before: Number
    after: Number
    own: Number
    share_of_torque: Number
    unexplained: Number


@dataclass(frozen=True, kw_only=True)
class ContrastCause:
    """One thing that changed between two sets of recordings.

    Attributes
    ----------
    effect : str
        Name in the catalogue.
    kind : str
    joint, other_joint : str or None
    change : str
        ``appeared`` and ``vanished`` where one set alone has the effect, else ``changed``.
    bags : tuple of str
        Recordings of the second set that it holds for.
    parameters : dict of str to EffectParameter
        Second set less reference; of an effect that one set alone has, its numbers there.
    reference, against : dict of str to EffectParameter
        The numbers in each set, where they are known one by one.
    evidence : Evidence
        `folds_positive`: blocks of time that it predicts better.
    indistinguishable_from : tuple of Indistinguishable
    torques : tuple of JointTorque
        Joints where it matters, its own first.
    sentence : str
    """

    effect: str
    kind: Kind
    joint: str | None
    other_joint: str | None = None
    change: Literal["appeared", "vanished", "changed"]
    bags: tuple[str, ...]
    parameters: dict[str, EffectParameter]
    reference: dict[str, EffectParameter] = field(default_factory=dict)
    against: dict[str, EffectParameter] = field(default_factory=dict)
    evidence: Evidence
    indistinguishable_from: tuple[Indistinguishable, ...] = ()
    torques: tuple[JointTorque, ...] = ()
    sentence: str


@dataclass(frozen=True, kw_only=True)
class ContrastResult:
    """What changed between a reference set of recordings and a second one.

    Attributes
    ----------
    reference, against : tuple of str
        Recordings.
    differs : bool
    test : HypothesisTest
        F test of H0: one set of base parameters holds for both, beside effects that differ.
    sentence : str
        The answer, in words.
    joints : tuple of JointContrast
    causes : tuple of ContrastCause
        Strongest first; empty where the sets do not differ, or where nothing explains it.
    nameless : tuple of str
        Differences outside the catalogue, in words.
    common : tuple of str
        Effects that both sets have alike, in words.
    effort_shift : dict of str to EffectParameter
        Time from the recorded effort to the torque, s, of ``reference`` and ``against``.
    notes : tuple of str
        What could not be compared and why.
    """

    reference: tuple[str, ...]
    against: tuple[str, ...]
    differs: bool
    test: HypothesisTest
    sentence: str
    joints: tuple[JointContrast, ...]
    causes: tuple[ContrastCause, ...]
    nameless: tuple[str, ...] = ()
    common: tuple[str, ...] = ()
    effort_shift: dict[str, EffectParameter] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class NominalModel:
    """A nominal model that was read from a result instead of the URDF.

    Attributes
    ----------
    file : str
    robot : str
    left_out : tuple of str
        Effects that the file names and that are no part of the nominal model.
    parameters : dict of str to EffectParameter
        Base parameters.
    """

    file: str
    robot: str
    left_out: tuple[str, ...]
    parameters: dict[str, EffectParameter]


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

    Attributes
    ----------
    format : str
    robot : str
    joints, joint_types : tuple of str
    bags : tuple of str
    session : tuple of SessionPart
        Where each recording lies in the time of the session, in the order of `bags`.
    software : dict
    without : tuple of str
        Effects that were left out of the catalogue.
    verdict : str
    summary : str
        One paragraph that a robot engineer can act on.
    causes : tuple of Cause
        Strongest first.
    hints : tuple of Hint
        No causes: they count for no verdict and are not handed on to a simulator.
    unexplained : Unexplained or None
    parameter_errors : tuple of ParameterError
        One for each joint; empty without a nominal model.
    signal_chain : SignalChain or None
    recordings : tuple of RecordingAgreement
        In the order of `bags`; empty of a single recording.
    contrast : ContrastResult or None
        What changed in a second set of recordings; all else is of the reference set, `bags`.
    nominal : NominalModel or None
        Where the nominal model was read from; None: the URDF's.
    transmissions : tuple of Transmission
        One for each joint with an encoder behind its gear.
    where : Where
    findings : tuple of str
        The top regimes in words.
    not_testable : tuple of NotTestable
    stages : tuple of Stage
    notes : tuple of str
        What could not be done and why.
    extended_parameters : dict of str to EffectParameter
        Base parameters of the extended model.
    physical : PhysicalParameters or None
        Nearest to the base parameters of the extended model.
    why_no_physical : str
        Why there are none; empty where there are.
    kinematics : str
        Digest of the geometry (`kinematics_digest`): to which URDF the result belongs.
    configuration : dict
    timing : dict of str to float
        Seconds by stage.
    confusability : tuple of Confusability
    series : tuple of GapSeries
    tracking : tuple of TrackingSeries
    twists : tuple of TransmissionSeries
        These four are for the report and not in the document.
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
    causes: tuple[Cause, ...]
    hints: tuple[Hint, ...] = ()
    unexplained: Unexplained | None
    parameter_errors: tuple[ParameterError, ...] = ()
    signal_chain: SignalChain | None = None
    recordings: tuple[RecordingAgreement, ...] = ()
    contrast: ContrastResult | None = None
    nominal: NominalModel | None = None
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
    confusability: Unsaved[tuple[Confusability, ...]] = field(default=(), compare=False)
    series: Unsaved[tuple[GapSeries, ...]] = field(default=(), compare=False)
    tracking: Unsaved[tuple[TrackingSeries, ...]] = field(default=(), compare=False)
    twists: Unsaved[tuple[TransmissionSeries, ...]] = field(default=(), compare=False)

    @property
    def joint_gaps(self) -> tuple[JointGap, ...]:
        """The gap of the nominal model, joint by joint."""
        return self.where.joints

    @property
    def regimes(self) -> tuple[Regime, ...]:
        """Parts of the joints' samples, largest lift first."""
        return self.where.regimes

    @property
    def own_summary(self) -> str:
        """The summary of the recordings by themselves, without what changed in a second set."""
        if self.contrast is None:
            return self.summary
        return self.summary.removeprefix(self.contrast.sentence).strip()

    @property
    def recorded(self) -> float | None:
        """Length of all recordings together, without the pauses, s; None where not known."""
        return sum(part.duration for part in self.session) if self.session else None
