"""What recordings are: signal chain, transmissions, agreement, changes between two sets."""

from dataclasses import dataclass, field
from typing import Literal

from idim_iv_ros.diagnosis.result.causes import Attribution, Evidence, Indistinguishable
from idim_iv_ros.documents import Number
from idim_iv_ros.effects.cause import EffectParameter, Kind
from idim_iv_ros.types import FloatArray


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
    """Twist over load of one joint, less time offset, position and constants; (r,) each."""

    joint: str
    load: FloatArray  # N m
    twist: FloatArray  # rad
    direction: FloatArray  # of motion, −1 to 1


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
