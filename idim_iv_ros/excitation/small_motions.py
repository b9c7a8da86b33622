"""Segments of small amplitude about a posture: reversals and a multisine."""

import numpy as np

from idim_iv_ros.excitation.segment import SegmentPlan
from idim_iv_ros.excitation.shapes import waves
from idim_iv_ros.types import FloatArray

LOWEST_LINE = 0.5  # Hz
_FADE = 1.0  # s


def reversals(
    joints: int, amplitude: float, frequency: float, size: float, seconds: float, rate: float
) -> SegmentPlan:
    """Sine of all joints alike, faded in and out over one of its periods.

    Parameters
    ----------
    amplitude : rad (m)
    frequency : Hz
    size : factor of the amplitude
    """
    level, line = np.full((1, joints), size * amplitude), np.full((1, joints), frequency)
    shape = waves(level, line, np.zeros((1, joints)), seconds, 1.0 / frequency, rate)
    return SegmentPlan(
        f"reversals_{1000 * amplitude:g}_mrad_{frequency:g}_Hz",
        "reversals",
        np.zeros(joints),
        shape,
        amplitude=level[0],
        frequency=(frequency, frequency),
    )


def multisine(
    highest: FloatArray, amplitude: float, seconds: float, rate: float, seed: int
) -> SegmentPlan:
    """Sum of sines of random phase from 0.5 Hz up to `highest`, faded in and out over 1 s.

    Every joint has lines of its own, k/T with k ≡ joint modulo the number of joints, so that what
    one joint does to another can be told from its own response. All lines have the same velocity.

    Parameters
    ----------
    highest : (n_joints,) Hz
    amplitude : largest deviation, rad (m)
    """
    joints = len(highest)
    flat = max(seconds - 2.0 * _FADE, 2.0 / LOWEST_LINE)
    # At least two lines for each joint, however slow its loop.
    highest = np.maximum(highest, LOWEST_LINE + 2.0 * joints / flat)
    numbers = np.arange(1, int(highest.max() * flat) + 1)[:, None]
    lines = numbers / flat
    own = numbers % joints == np.arange(joints)
    used = own & (lines >= LOWEST_LINE) & (lines <= highest)
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, used.shape)
    frequency = np.broadcast_to(lines, used.shape)
    level = np.where(used, 1.0 / frequency, 0.0)
    total = flat + 2.0 * _FADE
    position, velocity, acceleration = waves(level, frequency, phase, total, _FADE, rate)
    scale = amplitude / np.abs(position).max(axis=0)
    shape = (scale * position, scale * velocity, scale * acceleration)
    return SegmentPlan(
        "multisine",
        "multisine",
        np.zeros(joints),
        shape,
        amplitude=np.full(joints, amplitude),
        frequency=(float(lines[used.any(axis=1)].min()), float(highest.max())),
    )
