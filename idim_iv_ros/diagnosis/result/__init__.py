"""What a diagnosis found: the document gap.json and what it consists of."""

from idim_iv_ros.diagnosis.result.causes import (
    Cause,
    Evidence,
    Gap,
    Hint,
    Indistinguishable,
    JointChange,
    ParameterError,
    SimulationGap,
    Unexplained,
)
from idim_iv_ros.diagnosis.result.document import GapResult, NominalModel, TrackingSeries, Verdict
from idim_iv_ros.diagnosis.result.localisation import (
    GapSeries,
    JointGap,
    NotTestable,
    Regime,
    Stage,
    Where,
)
from idim_iv_ros.diagnosis.result.recordings import (
    ContrastCause,
    ContrastResult,
    Difference,
    JointContrast,
    JointTorque,
    RecordingAgreement,
    SignalChain,
    Transmission,
    TransmissionSeries,
)
from idim_iv_ros.effects.cause import EffectParameter

__all__ = [
    "Cause",
    "ContrastCause",
    "ContrastResult",
    "Difference",
    "EffectParameter",
    "Evidence",
    "Gap",
    "GapResult",
    "GapSeries",
    "Hint",
    "Indistinguishable",
    "JointChange",
    "JointContrast",
    "JointGap",
    "JointTorque",
    "NominalModel",
    "NotTestable",
    "ParameterError",
    "RecordingAgreement",
    "Regime",
    "SignalChain",
    "SimulationGap",
    "Stage",
    "TrackingSeries",
    "Transmission",
    "TransmissionSeries",
    "Unexplained",
    "Verdict",
    "Where",
]
