"""One fine step of the true robot between two commands."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks.withheld_effects.drive import Drive
from benchmarks.withheld_effects.dry_friction import bristle_share, dry_level, sliding_torque
from benchmarks.withheld_effects.rigid_body import mass_and_bias
from benchmarks.withheld_effects.sticking import inverse, stick_or_slip
from benchmarks.withheld_effects.transmission import link_torque, motor_torque, shaft

FloatArray = NDArray[np.float64]


class State(NamedTuple):
    """State and work space: the n links first, then the motors that are masses of their own."""

    motor: NDArray[np.int64]  # (n,) place of each joint's motor
    position: FloatArray  # (size,) rad
    velocity: FloatArray  # (size,) rad/s
    before: FloatArray  # (size,) rad/s, before the step
    middle: FloatArray  # (size,) rad, half a step ahead
    push: FloatArray  # (size,) N m
    mass: FloatArray  # (n, n) kg m²
    bias: FloatArray  # (n,) N m
    effective: FloatArray  # (size, size) kg m²
    mobility: FloatArray  # (size, size)
    bend: FloatArray  # (n, BRISTLES) rad
    heat: FloatArray  # (n,)
    direction: FloatArray  # (rows, size) speeds that dry friction resists
    moved: FloatArray  # (rows, size)
    lower: FloatArray  # (rows,) N m s
    upper: FloatArray  # (rows,) N m s
    impulse: FloatArray  # (rows,) N m s


@njit(cache=True)
def at_rest(drive: Drive, position: np.ndarray, heat: np.ndarray) -> State:
    """Links at `position` (n,) rad, motors with them; `heat` (n,) is kept, not copied."""
    n = len(position)
    motor, size = np.arange(n), n
    for j in range(n):
        if drive.stiffness[j] > 0.0:
            motor[j] = size
            size += 1
    paired = drive.pair_dry[0] > 0.0 or drive.pair_viscous[0] != 0.0
    rows = n + 1 if paired else n
    direction = np.zeros((rows, size))
    x = np.zeros(size)
    for j in range(n):
        direction[j, motor[j]] = 1.0
        x[j] = x[motor[j]] = position[j]
    if paired:
        direction[n, motor[drive.pair[0]]] = 1.0
        direction[n, motor[drive.pair[1]]] = drive.pair_ratio[0]
    return State(
        motor,
        x,
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
        np.zeros((n, n)),
        np.zeros(n),
        np.zeros((size, size)),
        np.zeros((size, size)),
        np.zeros(drive.bristle_weight.shape),
        heat,
        direction,
        np.zeros((rows, size)),
        np.zeros(rows),
        np.zeros(rows),
        np.zeros(rows),
    )


@njit(cache=True, forceinline=True)
def advance(
    addresses: tuple[int, int],
    views: tuple[np.ndarray, np.ndarray, np.ndarray],
    drive: Drive,
    state: State,
    sent: np.ndarray,
    external: np.ndarray,
    step: float,
) -> None:
    """Move `state` by `step` s under the commands `sent` and torques `external` (n,) N m.

    `addresses` and `views` as in `mass_and_bias`.
    """
    n, size = len(state.motor), len(state.position)
    for i in range(size):
        state.middle[i] = state.position[i] + 0.5 * step * state.velocity[i]
        state.before[i] = state.velocity[i]
    mass_and_bias(
        addresses[0],
        addresses[1],
        views,
        state.middle[:n],
        state.velocity[:n],
        state.mass,
        state.bias,
    )
    state.effective[:] = 0.0
    state.effective[:n, :n] = state.mass
    for j in range(n):
        m = state.motor[j]
        state.push[m] = 0.0
        state.push[j] = link_torque(drive, j, state.middle[j], state.velocity[j])
        state.push[j] += external[j] - state.bias[j]
        _motor(drive, state, j, sent[j], step)
        if m != j:
            _shaft(drive, state, j, step)
    if len(state.lower) > n:
        _pair(drive, state, step)
    inverse(state.effective, state.mobility)
    for i in range(size):
        for r in range(size):
            state.velocity[i] += step * state.mobility[i, r] * state.push[r]
    stick_or_slip(
        state.mobility,
        state.velocity,
        state.direction,
        state.lower,
        state.upper,
        state.impulse,
        state.moved,
    )
    # A torque held during the step moves a joint like this exactly: no lag of half a step.
    for i in range(size):
        state.position[i] += 0.5 * step * (state.before[i] + state.velocity[i])


@njit(cache=True, forceinline=True)
def _motor(drive: Drive, state: State, j: int, sent: float, step: float) -> None:
    """Torque, inertia and friction of motor j."""
    m = state.motor[j]
    angle, speed, heat = state.middle[m], state.velocity[m], state.heat[j]
    torque = motor_torque(drive, j, sent, angle)
    viscous, drag = sliding_torque(drive, j, speed, heat)
    state.effective[m, m] += drive.inertia[j] + 0.5 * step * viscous
    state.push[m] += torque - drive.offset[j] + drag - viscous * speed
    load = state.bias[j] if drive.load_static[j] > 0.0 else torque
    forward = dry_level(drive, j, angle, speed, load, heat, True)
    backward = dry_level(drive, j, angle, speed, load, heat, False)
    state.lower[j], state.upper[j] = -step * forward, step * backward
    travel = drive.bristle_travel[j]
    if travel > 0.0:
        state.lower[j] = state.upper[j] = 0.0
        share = bristle_share(
            state.bend[j], travel, drive.bristle_span[j], drive.bristle_weight[j], step * speed
        )
        state.push[m] -= share * (forward if share > 0.0 else backward)
    rate = (speed / drive.warm_speed[j]) ** 2 - heat
    state.heat[j] += step * rate / drive.warm_time[j]


@njit(cache=True, forceinline=True)
def _shaft(drive: Drive, state: State, j: int, step: float) -> None:
    """Shaft of joint j, linearised in the new velocities so that a stiff one stays stable."""
    m = state.motor[j]
    rate = state.velocity[m] - state.velocity[j]
    carried, stiff, loss = shaft(drive, j, state.position[m] - state.position[j], rate)
    carried += step * stiff * rate
    slope = step * loss + step * step * stiff
    state.push[j] += carried
    state.push[m] -= carried
    state.effective[j, j] += slope
    state.effective[m, m] += slope
    state.effective[j, m] -= slope
    state.effective[m, j] -= slope


@njit(cache=True, forceinline=True)
def _pair(drive: Drive, state: State, step: float) -> None:
    """Friction of the sum of two speeds."""
    a, b, ratio = state.motor[drive.pair[0]], state.motor[drive.pair[1]], drive.pair_ratio[0]
    speed = state.velocity[a] + ratio * state.velocity[b]
    drag = -drive.pair_viscous[0] * np.sign(speed) * abs(speed) ** drive.pair_exponent[0]
    state.push[a] += drag
    state.push[b] += ratio * drag
    state.lower[-1], state.upper[-1] = -step * drive.pair_dry[0], step * drive.pair_dry[0]
