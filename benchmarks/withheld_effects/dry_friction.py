"""Dry friction that sticks, slips, breaks away, loads, warms and bends."""

import numpy as np
from numba import njit

from benchmarks.withheld_effects.drive import Drive


@njit(cache=True, forceinline=True)
def dry_level(
    drive: Drive, j: int, position: float, velocity: float, load: float, heat: float, forward: bool
) -> float:
    """Bound of the dry friction torque of joint j that opposes one direction, N m, >= 0.

    Parameters
    ----------
    position, velocity : of the motor, rad, rad/s
    load : torque that the gear carries, N m
    heat : 0 cold to about 1 warm
    forward : against positive speed
    """
    level = drive.dry_forward[j] if forward else drive.dry_backward[j]
    if drive.patch[j, 0] != 0.0:
        angle = drive.patch_wave[j] * (position - drive.patch_at[j, 0])
        # Not a sine: a second, incommensurate wave rides on it.
        level *= 1.0 + drive.patch[j, 0] * (np.sin(angle) + 0.4 * np.sin(2.3 * angle + 0.7)) / 1.3
    if drive.patch[j, 1] != 0.0:
        away = (position - drive.patch_at[j, 1]) / drive.patch_width[j]
        level *= 1.0 + drive.patch[j, 1] * np.exp(-(away**2))
    level *= 1.0 - drive.warm_dry[j] * heat
    if drive.breakaway[j] != 0.0:
        slow = abs(velocity) / drive.breakaway_speed[j]
        level += drive.breakaway[j] * np.exp(-(slow ** drive.breakaway_exponent[j]))
    if drive.load[j] != 0.0:
        side = 1.0 if (load > 0.0) == forward else -1.0
        carried = abs(load) / drive.load_scale[j]
        level += (
            drive.load[j]
            * carried ** drive.load_exponent[j]
            * (1.0 + side * drive.load_direction[j])
        )
    return max(level, 0.0)


@njit(cache=True, forceinline=True)
def bristle_share(
    bend: np.ndarray, travel: float, span: np.ndarray, weight: np.ndarray, shift: float
) -> float:
    """Share of the dry friction, -1 to 1, of a bundle of bristles after a motion of `shift` rad.

    Each bristle bends up to its own span and then slips (Maxwell-slip), so that the torque
    depends on the path and not on time. `bend` (BRISTLES,) rad is updated in place.
    """
    share = 0.0
    for k in range(len(bend)):
        reach = travel * span[k]
        bend[k] = min(max(bend[k] + shift, -reach), reach)
        share += weight[k] * bend[k] / reach
    return share


@njit(cache=True, forceinline=True)
def sliding_torque(drive: Drive, j: int, velocity: float, heat: float) -> tuple[float, float]:
    """Viscous coefficient (N m s/rad, >= 0, taken implicitly) and remaining drag torque (N m)."""
    viscous = drive.viscous_forward[j] if velocity >= 0.0 else drive.viscous_backward[j]
    viscous *= 1.0 - drive.warm_viscous[j] * heat
    torque = 0.0
    if drive.drag[j] != 0.0:
        torque = -drive.drag[j] * abs(velocity) ** drive.drag_exponent[j] * np.sign(velocity)
    return viscous, torque
