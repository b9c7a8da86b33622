"""What changed between two sets of recordings."""

from dataclasses import dataclass, field
from typing import Literal

from idim_iv_ros.diagnosis.result.evidence import Evidence, Indistinguishable
from idim_iv_ros.documents import Number
from idim_iv_ros.effects.cause import EffectParameter, Kind


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
        With the causes that are listed.
    own : float
        With numbers of its own besides, in each quarter of a recording as the others have them.
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
    sentence : str
        The answer, in words.
    joints : tuple of JointContrast
    causes : tuple of ContrastCause
        Strongest first; empty where the sets do not differ, or where nothing explains it.
    unattributed : tuple of str
        Differences outside the catalogue, in words.
    common : tuple of str
        Effects that both sets share, in words.
    effort_shift : dict of str to EffectParameter
        Time from the recorded effort to the torque, s, of ``reference`` and ``against``.
    notes : tuple of str
        What could not be compared and why.
    """

    reference: tuple[str, ...]
    against: tuple[str, ...]
    differs: bool
    sentence: str
    joints: tuple[JointContrast, ...]
    causes: tuple[ContrastCause, ...]
    unattributed: tuple[str, ...] = ()
    common: tuple[str, ...] = ()
    effort_shift: dict[str, EffectParameter] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
