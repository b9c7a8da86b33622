"""What effects do to the control loop around the plant: delay, law and encoders."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from idim_iv_ros.simulation.effects import JointEffect
from idim_iv_ros.types import FloatArray


def delays(effects: Sequence[JointEffect], n: int) -> FloatArray:
    """Delay of each joint's command beyond that of the law, (n_joints,) s."""
    late = np.zeros(n)
    for one in effects:
        if one.effect == "time_delay":
            late[one.joint] += one.value["delay"]
    return late


def lags(effects: Sequence[JointEffect], n: int) -> FloatArray:
    """Time constant of the first-order filter behind each joint's law, (n_joints,) s."""
    late = np.zeros(n)
    for one in effects:
        if one.effect == "controller_mismatch":
            late[one.joint] = one.value["lag"]
    return late


class LawParts(NamedTuple):
    """Torque gains (n_joints,) and feedforward (n_samples, n_joints) of a law."""

    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    feedforward: FloatArray


def mismatched(
    law: LawParts,
    effects: Sequence[JointEffect],
    velocity_reference: FloatArray,
    rate: float,
) -> LawParts:
    """Put the robot's gains and feedforward in the place of those of the configuration."""
    kp, kd, ki, feedforward = (part.copy() for part in law)
    for one in effects:
        if one.effect != "controller_mismatch":
            continue
        j, v = one.joint, one.value
        for gains, key in ((kp, "kp"), (kd, "kd"), (ki, "ki")):
            if not np.isnan(v[key]):
                gains[j] = v[key]
        speed = velocity_reference[:, j]
        feedforward[:, j] += v["feedforward_velocity"] * speed
        if len(speed) > 1:
            feedforward[:, j] += v["feedforward_acceleration"] * np.gradient(speed, 1.0 / rate)
    return LawParts(kp, kd, ki, feedforward)


def encoder_error(
    effects: Sequence[JointEffect], position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What encoders add to true positions (…, n_joints), and its derivative by position."""
    error, slope = np.zeros_like(position), np.zeros_like(position)
    for one in effects:
        if one.effect == "encoder_eccentricity":
            q, v = position[..., one.joint], one.value
            for order, end in ((1, ""), (2, "_2")):
                s, c = np.sin(order * q), np.cos(order * q)
                sine, cosine = v["sine" + end], v["cosine" + end]
                error[..., one.joint] += sine * s + cosine * c
                slope[..., one.joint] += order * (sine * c - cosine * s)
    return error, slope


def true_state(
    effects: Sequence[JointEffect], position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Position and velocity (n_joints,) of the motors where the encoders show these."""
    true = position.copy()
    for _ in range(20):  # the error's slope is far below one
        error, slope = encoder_error(effects, true)
        true = true - (true + error - position) / (1.0 + slope)
    return true, velocity / (1.0 + encoder_error(effects, true)[1])
