"""What a recording without torques tells of a robot's servos: the document servo.json."""

from dataclasses import dataclass, field
from typing import ClassVar

from idim_iv_ros.documents import Document, HighEnd, LowEnd, Number, Unsaved
from idim_iv_ros.files import SERVO_FORMAT
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True, kw_only=True)
class ServoNumber:
    """A number of a servo with its 95 % interval.

    - `shown`: whether the recording tells it from zero (of a limit: whether it was reached).
      Otherwise `high` (of a limit: `low`) bounds it, and `value` is where the fit ended.
    """

    name: str
    unit: str
    value: Number
    low: LowEnd
    high: HighEnd
    shown: bool


@dataclass(frozen=True, kw_only=True)
class ServoJoint:
    """The servo of one joint.

    - `absolute`: whether `numbers` are torques. They are where the rigid bodies' torques show in
      the motion; elsewhere only ratios to the stiffness of the loop are known.
    - `reason`: why not; empty where they are
    - `numbers`: absolute ones, or none
    - `ratios`: the same divided by the stiffness, and what needs no torque: delay, offset, limits
    - `residual`, `held_out`: root mean square of measured less simulated position, rad: of the fit,
      and of each half of the recordings when only the other was used
    - `nominal`: root mean square of command less measured position, rad: what a simulator with
      perfect tracking misses
    - `resolution`: smallest step between recorded positions, rad
    """

    joint: str
    absolute: bool
    reason: str
    numbers: tuple[ServoNumber, ...]
    ratios: tuple[ServoNumber, ...]
    residual: float
    held_out: Number
    nominal: float
    resolution: float | None

    def number(self, name: str) -> ServoNumber | None:
        """Absolute number or ratio of a name; None where there is none."""
        return next((n for n in (*self.numbers, *self.ratios) if n.name == name), None)


@dataclass(frozen=True, kw_only=True)
class GainCheck:
    """Whether the gain of one recording is the one that was said.

    - `given`, `estimated`, `low`, `high`: the gain that suits the servo found on the other
      recordings, with its 95 % interval
    """

    recording: str
    joint: str
    given: float
    estimated: float
    low: float
    high: float
    agrees: bool


@dataclass(frozen=True, kw_only=True)
class ServoSeries:
    """Motion of one joint in one recording, for its picture; (n,) s and rad."""

    joint: str
    recording: str
    time: FloatArray
    command: FloatArray
    measured: FloatArray
    simulated: FloatArray


@dataclass(frozen=True, kw_only=True)
class ServoResult(Document):
    """Servos of a robot that records no efforts.

    - `gain`: of the servo's own setting, for which stiffness and ratios are given; 1 without
    - `gains`: empty with one recording, or without gains
    - `model_error`: standard deviation of the nominal rigid-body torques that was assumed, as a
      share; absolute numbers are as wrong as they are
    - `timing`: s
    """

    what: ClassVar[str] = "an identification of servos"
    written_by: ClassVar[str] = "servo"

    format: str = SERVO_FORMAT
    robot: str
    recordings: tuple[str, ...]
    gain: float
    joints: tuple[ServoJoint, ...]
    gains: tuple[GainCheck, ...]
    model_error: float
    warnings: tuple[str, ...]
    software: dict[str, str]
    timing: dict[str, float]
    series: Unsaved[tuple[ServoSeries, ...]] = field(default=())
