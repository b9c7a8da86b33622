"""The document gap.json, and the series that its report draws."""

from dataclasses import dataclass, field
from typing import ClassVar, Literal

from idim_iv_ros.diagnosis.result.causes import Cause, Hint, ParameterError, Unexplained
from idim_iv_ros.diagnosis.result.localisation import (
    GapSeries,
    JointGap,
    NotTestable,
    Regime,
    Stage,
    Where,
)
from idim_iv_ros.diagnosis.result.recordings import (
    ContrastResult,
    RecordingAgreement,
    SignalChain,
    Transmission,
    TransmissionSeries,
)
from idim_iv_ros.documents import Document, Number, Unsaved
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.files import GAP_FORMAT
from idim_iv_ros.physical import PhysicalParameters
from idim_iv_ros.recording import SessionPart
from idim_iv_ros.types import FloatArray

Verdict = Literal["none", "parametric", "structural", "both", "unknown"]


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
    friction_leads : dict of str to float
        s by which dry friction turns before its joint, as a simulator's solver softens it; only
        joints where it does.
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
    series : tuple of GapSeries
    tracking : tuple of TrackingSeries
    twists : tuple of TransmissionSeries
        These three are for the report and not in the document.
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
    friction_leads: dict[str, Number] = field(default_factory=dict)
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
