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

# Numbers that a term keeps from one time step to the next, at most.
STATES = 2
# Speed below which friction is not divided by it, rad/s.
LEAST_SPEED = 1e-9
# Share of a reference's largest speed below which it is reversing.
_REVERSING = 0.02


class Load(IntEnum):
    """Torque that the load of a joint is taken as.

    Of the rigid links: all of it, or without their accelerations (gravity and Coriolis). Of the
    motor: that of the whole model (links, drives, friction, offset).
    """

    LINKS = 0
    MOTOR = 1
    STATIC = 2


class Instant(NamedTuple):
    """Where a joint is at the middle of a time step.

    `time`, `elapsed`: s since the start of the session, and of the recording; `position`: rad (m);
    `speed`: rad/s (m/s) in the direction in which it moves, not negative; of a coupling that of its
    contact; `direction`: 1 or −1, in which it moves or, at rest, would be moved; 0 where nothing
    moves it; `load`: N m (N), what the term takes as such (`TorqueTerm.load`); `velocity`: at the
    start of the step, which lasts `step` s.
    """

    time: float
    elapsed: float
    position: float
    speed: float
    direction: float
    load: float
    velocity: float
    step: float


class Torque(NamedTuple):
    """What a term adds at an instant: all that opposes motion as level or damping.

    `level`: dry friction, N m (N); `damping`: N m s/rad; `force`: torque that the motor must
    overcome in either direction, N m (N); `stiffness`: slope of `force` over the position, N m/rad,
    where it must enter the step implicitly.
    """

    level: float
    damping: float
    force: float
    stiffness: float


@kernel
def _keeps(p: FloatArray, state: FloatArray, dq: float, ddq: float, step: float) -> bool:
    """State that no time step changes so much that it must be computed anew."""
    return False


@dataclass(frozen=True, eq=False)
class TorqueLaw:
    """Torque of a term at an instant, compiled: (p, at: Instant, state) -> Torque.

    `advance`: (p, state, dq, ddq, step) -> None moves the state (STATES,) along a step that starts
    at velocity dq; None for a law without state. `turns`, with the same arguments: whether the
    state turns into another regime within this step, which is then set: the step is to be computed
    anew.
    """

    torque: Callable[..., Any]
    advance: Callable[..., Any] | None = None
    turns: Callable[..., Any] = _keeps


@dataclass(frozen=True, eq=False)
class DriveLaw:
    """Torque that acts for a commanded one, compiled: (p, command) -> torque.

    Of several at a joint, the one of the lowest `rank` acts first.
    """

    curve: Callable[..., Any]
    rank: int


@dataclass(frozen=True, eq=False)
class EncoderLaw:
    """What an encoder adds to a position and its slope, compiled: (p, q) -> (error, slope).

    `error.py_func` is called with arrays, too: it uses NumPy's functions and no compiled ones.
    """

    error: Callable[..., Any]


Law = TorqueLaw | DriveLaw | EncoderLaw


@dataclass(frozen=True)
class TorqueTerm:
    """A torque at the joint.

    `friction`: whether only together with the model's friction it is kept from driving; `dry`:
    whether it lets the joint stick; `replaced`: model's Coulomb friction that it takes the place
    of, N m (N).
    """

    law: TorqueLaw
    values: tuple[float, ...]
    friction: bool = False
    dry: bool = False
    replaced: float = 0.0
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
    """Part of what is between motor and link.

    `gap`: dead zone of ± gap/2, rad (m); `stiffness`, `damping`: N m/rad, N m s/rad; NaN: from the
    inertias; `flanks`: whether the stiffness is that of flanks alone, which beside a shaft are
    rigid.
    """

    gap: float
    stiffness: float
    damping: float
    flanks: bool


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
    """The law that the robot runs in the place of the configured one.

    `kp`, `kd`, `ki`: from errors to torque; NaN: as configured; feedforward of velocity,
    acceleration and friction: N m s/rad, kg m², N m; `lag`: time constant of a first-order filter
    behind the law, s.
    """

    kp: float
    kd: float
    ki: float
    feedforward_velocity: float
    feedforward_acceleration: float
    feedforward_friction: float
    lag: float


@dataclass(frozen=True)
class Element:
    """Numbers of elements of MuJoCo that are exactly an effect; empty where it has no such number.

    `damping`: (∣v∣v, v³) of its joint, N m s²/rad², N m s³/rad³; `stiffness`: (q, q², q³) of its
    joint, N m/rad, N m/rad², N m/rad³; `tendon`: (direction, damping, dry friction) of a fixed
    tendon over both joints.
    """

    damping: tuple[float, ...] = ()
    stiffness: tuple[float, ...] = ()
    tendon: tuple[float, ...] = ()


@dataclass(frozen=True)
class CommandParts:
    """What one joint's command may be made of, (n_samples,) each, at the rate of the recording.

    `command`: N m (N), of the configured law without limit, on the measured position; `rate`: of
    it, N m/s; `late` (n_samples, 4): change with the time by which position, speed and the
    references of both are late, N m/s; `groups`: torque of a unit of each group that may be
    another.
    """

    command: FloatArray
    rate: FloatArray
    late: FloatArray
    groups: dict[str, FloatArray]


def reference_direction(speed: FloatArray) -> FloatArray:
    """Direction (n_samples,) of a reference's speed, without a step where it reverses."""
    slow = _REVERSING * float(np.abs(speed).max(initial=0.0))
    return np.tanh(speed / max(slow, 1e-300))


Contribution = (
    TorqueTerm | CouplingTerm | ShaftPart | DriveCurve | EncoderError | CommandDelay | LawChange
)
