"""Conservative torques over the position, and the shaft between a motor and its link."""

import numpy as np
from numba import njit

from benchmarks.withheld_effects.drive import Drive


@njit(cache=True, forceinline=True)
def shaft(drive: Drive, j: int, twist: float, twist_rate: float) -> tuple[float, float, float]:
    """Torque on the link (N m), stiffness (N m/rad) and damping (N m s/rad) at this twist.

    Parameters
    ----------
    twist : motor less link, rad
        Inside the gap nothing is carried; outside, the flank neither pulls nor sticks.
    """
    half = 0.5 * drive.gap[j]
    if half > 0.0 and abs(twist) <= half:
        return 0.0, 0.0, 0.0
    bent = twist - np.sign(twist) * half
    hard = drive.hardening[j] * bent * bent
    torque = drive.stiffness[j] * bent * (1.0 + hard)
    stiffness = drive.stiffness[j] * (1.0 + 3.0 * hard)
    damped = torque + drive.damping[j] * twist_rate
    if half > 0.0 and damped * bent < 0.0:
        return 0.0, 0.0, 0.0
    return damped, stiffness, drive.damping[j]


@njit(cache=True, forceinline=True)
def link_torque(drive: Drive, j: int, position: float, velocity: float) -> float:
    """Torque of springs and stops on the link, N m."""
    torque = 0.0
    if drive.spring[j] != 0.0:
        bend = drive.spring_bend[j]
        away = (position - drive.spring_at[j]) / abs(bend)
        shape = np.sinh(away) if bend > 0.0 else np.arctan(away)
        torque -= drive.spring[j] * abs(bend) * shape
    if drive.stop[j] != 0.0:
        side = drive.stop_side[j]
        depth = side * (position - drive.stop_at[j])
        if depth > 0.0:
            push = drive.stop[j] * depth**1.5 * (1.0 + 0.3 * side * velocity)
            torque -= side * max(push, 0.0)
    return torque


@njit(cache=True, forceinline=True)
def motor_torque(drive: Drive, j: int, command: float, position: float) -> float:
    """Torque of the motor for a command, N m: gain, knee, ripple."""
    torque = drive.gain[j] * command
    over = abs(torque) - drive.knee[j]
    if over > 0.0:
        torque -= np.sign(torque) * over * (1.0 - drive.knee_slope[j])
    for k in range(2):
        if drive.ripple[j, k] != 0.0:
            angle = drive.ripple_wave[j, k] * position + drive.ripple_phase[j, k]
            torque += drive.ripple[j, k] * np.sin(angle)
    return torque


@njit(cache=True, forceinline=True)
def encoder_error(drive: Drive, j: int, position: float) -> float:
    """What a wrong zero and an eccentric disc add to the measured position, rad."""
    phase = drive.eccentricity_phase[j]
    once = drive.eccentricity[j, 0] * np.sin(position + phase[0])
    return drive.zero[j] + once + drive.eccentricity[j, 1] * np.sin(2.0 * position + phase[1])
