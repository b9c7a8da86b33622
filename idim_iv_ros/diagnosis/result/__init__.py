"""What a diagnosis found: the document gap.json and what it consists of."""

from idim_iv_ros.diagnosis.result.causes import Cause, Hint, ParameterError, Unexplained
from idim_iv_ros.diagnosis.result.contrast import (
    ContrastCause,
    ContrastResult,
    JointContrast,
    JointTorque,
)
from idim_iv_ros.diagnosis.result.document import GapResult, NominalModel, TrackingSeries, Verdict
from idim_iv_ros.diagnosis.result.evidence import (
    NOT_CALIBRATED,
    Evidence,
    Gap,
    Indistinguishable,
    JointChange,
    SimulationGap,
)
from idim_iv_ros.diagnosis.result.localisation import (
    Confusability,
    GapSeries,
    JointGap,
    NotTestable,
    Regime,
    Stage,
    Where,
)
from idim_iv_ros.diagnosis.result.recordings import (
    Difference,
    RecordingAgreement,
    SignalChain,
    Transmission,
    TransmissionSeries,
)
from idim_iv_ros.effects.cause import EffectParameter

__all__ = [
    "NOT_CALIBRATED",
    "Cause",
    "Confusability",
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
