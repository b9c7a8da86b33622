"""What an effect adds to a simulated robot: the few kinds of contribution that a file declares.

The laws are compiled functions of plain numbers; the simulator calls them without knowing whose
they are. `p` are the values of a contribution, in the order that its file gives them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.types import FloatArray

STATES = 2  # Numbers that a term keeps from one time step to the next, at most
LEAST_SPEED = 1e-9  # Speed below which friction is not divided by it, rad/s
_REVERSING = 0.02  # Share of a reference's largest speed below which it is reversing


class Load(IntEnum):
    """Torque that the load of a joint is taken as.

    Of the rigid links: all of it, or without their accelerations (gravity and Coriolis). Of the
    motor: that of the whole model (links, drives, friction, offset).
    """

    LINKS = 0
    MOTOR = 1
    STATIC = 2


class Instant(NamedTuple):
    """Where a joint is at the middle of a time step."""

    time: float  # s since the start of the session
    elapsed: float  # s since the start of the recording
    position: float  # rad (m)
    # rad/s (m/s) in the direction in which it moves, not negative; of a coupling, of its contact
    speed: float
    # 1 or −1, in which it moves or, at rest, would be moved; 0 where nothing moves it
    direction: float
    load: float  # N m (N), what the term takes as such (`TorqueTerm.load`)
    velocity: float  # rad/s (m/s) at the start of the step
    step: float  # s, how long the step lasts


class Torque(NamedTuple):
    """What a term adds at an instant: all that opposes motion as level or damping."""

    level: float  # Dry friction, N m (N)
    damping: float  # N m s/rad
    force: float  # Torque that the motor must overcome in either direction, N m (N)
    # Slope of `force` over the position, N m/rad, where it must enter the step implicitly
    stiffness: float


@kernel
def _keeps(p: FloatArray, state: FloatArray, dq: float, ddq: float, step: float) -> bool:
    """State that no time step changes so much that it must be computed anew."""
    return False


@dataclass(frozen=True, eq=False)
class TorqueLaw:
    """Torque of a term at an instant, compiled."""

    torque: Callable[..., Any]  # (p, at: Instant, state) -> Torque
    # (p, state, dq, ddq, step) -> None moves the state (STATES,) along a step that starts at
    # velocity dq; None for a law without state
    advance: Callable[..., Any] | None = None
    # The same arguments: whether the state turns into another regime within this step, which is
    # then set: the step is to be computed anew
    turns: Callable[..., Any] = _keeps


@dataclass(frozen=True, eq=False)
class DriveLaw:
    """Torque that acts for a commanded one, compiled."""

    curve: Callable[..., Any]  # (p, command) -> torque
    rank: int  # Of several at a joint, the one of the lowest acts first


@dataclass(frozen=True, eq=False)
class EncoderLaw:
    """What an encoder adds to a position and its slope, compiled: (p, q) -> (error, slope)."""

    # Its `py_func` is called with arrays, too: it uses NumPy's functions and no compiled ones
    error: Callable[..., Any]


Law = TorqueLaw | DriveLaw | EncoderLaw


@dataclass(frozen=True)
class TorqueTerm:
    """A torque at the joint."""

    law: TorqueLaw
    values: tuple[float, ...]
    friction: bool = False  # Whether only with the model's friction it must not drive
    dry: bool = False  # Whether it lets the joint stick
    replaced: float = 0.0  # Model's Coulomb friction that it takes the place of, N m (N)
    load: Load = Load.LINKS


@dataclass(frozen=True)
class CouplingTerm:
    """Friction between the joint and another: of the sum (direction 1) or difference (−1)."""

    law: TorqueLaw
    values: tuple[float, ...]
    direction: float
    dry: bool


@dataclass(frozen=True)
class ShaftPart:
    """Part of what is between motor and link; stiffness or damping of NaN: from the inertias."""

    gap: float  # Dead zone of ± gap/2, rad (m)
    stiffness: float  # N m/rad
    damping: float  # N m s/rad
    flanks: bool  # Whether the stiffness is that of flanks alone, which beside a shaft are rigid


@dataclass(frozen=True)
class DriveCurve:
    """Change from the command to the acting torque."""

    law: DriveLaw
    values: tuple[float, ...]


@dataclass(frozen=True)
class EncoderError:
    """Error of an encoder: what it shows less the position of the joint."""

    law: EncoderLaw
    values: tuple[float, ...]


@dataclass(frozen=True)
class CommandDelay:
    """Delay of the command beyond that of the law, s."""

    seconds: float


@dataclass(frozen=True)
class LawChange:
    """The law that the robot runs in the place of the configured one; NaN: a gain as configured."""

    kp: float  # From errors to torque, as the next two
    kd: float
    ki: float
    feedforward_velocity: float  # N m s/rad
    feedforward_acceleration: float  # kg m²
    feedforward_friction: float  # N m
    lag: float  # Time constant of a first-order filter behind the law, s


@dataclass(frozen=True)
class Element:
    """Numbers of elements of MuJoCo that are exactly an effect; empty where it has none."""

    damping: tuple[float, ...] = ()  # (∣v∣v, v³) of its joint, N m s²/rad², N m s³/rad³
    stiffness: tuple[float, ...] = ()  # (q, q², q³) of its joint, N m/rad, N m/rad², N m/rad³
    # (direction, damping, dry friction) of a fixed tendon over both joints
    tendon: tuple[float, ...] = ()


@dataclass(frozen=True)
class CommandParts:
    """What one joint's command may be made of, (n_samples,) each, at the rate of the recording."""

    command: FloatArray  # N m (N), of the configured law without limit, on the measured position
    rate: FloatArray  # Of the command, N m/s
    # (n_samples, 4) N m/s: change with the time by which position, speed and the references of both
    # are late
    late: FloatArray
    groups: dict[str, FloatArray]  # Torque of a unit of each group that may be another


def reference_direction(speed: FloatArray) -> FloatArray:
    """Direction (n_samples,) of a reference's speed, without a step where it reverses."""
    slow = _REVERSING * float(np.abs(speed).max(initial=0.0))
    return np.tanh(speed / max(slow, 1e-300))


Contribution = (
    TorqueTerm | CouplingTerm | ShaftPart | DriveCurve | EncoderError | CommandDelay | LawChange
)


def contribution_of(law: Law, values: tuple[float, ...], friction: bool, dry: bool) -> Contribution:
    """Return what a law adds with these values; `friction`, `dry`: see `TorqueTerm`."""
    if isinstance(law, TorqueLaw):
        return TorqueTerm(law, values, friction, dry)
    return DriveCurve(law, values) if isinstance(law, DriveLaw) else EncoderError(law, values)
