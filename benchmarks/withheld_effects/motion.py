"""Reference motions: every recording excites everything, so that a motion betrays no effect."""

import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld_effects.robot import GivenRobot

FloatArray = NDArray[np.float64]
FADE = 0.8
PULSATIONS = 2.0 * np.pi * np.array([0.11, 0.19, 0.31, 0.53, 0.83, 1.27])


def rich_motion(
    given: GivenRobot, rng: np.random.Generator, seconds: float
) -> tuple[FloatArray, FloatArray]:
    """Sum of sines, then slow sweeps with reversals, then ramps of constant speed, then a chirp.

    The shares of the four, amplitudes and phases are drawn; each joint has its own.

    Returns
    -------
    position, velocity : (n_periods, n_joints) rad, rad/s
        At the control period, from rest to rest.
    """
    period = given.controller.period
    time = np.arange(round(seconds / period)) * period
    n = len(given.joints)
    room = 0.8 * np.minimum(given.upper - given.centre, given.centre - given.lower)
    shares = rng.dirichlet([30.0, 14.0, 10.0, 10.0])
    edges = np.concatenate([[0.0], np.cumsum(shares)]) * seconds
    position = np.tile(given.centre, (len(time), 1))
    for j in range(n):
        waves = (
            _sines(time, rng, room[j], given.fastest[j]),
            _slow_sweeps(time, rng),
            _ramps(time, rng, room[j], given.fastest[j]),
            _chirp(time, rng, edges[3], edges[4], given.fastest[j]),
        )
        for wave, start, stop in zip(waves, edges[:-1], edges[1:], strict=True):
            position[:, j] += _window(time, start, stop) * wave
    return position, np.gradient(position, period, axis=0)


def poor_motion(
    given: GivenRobot, rng: np.random.Generator, seconds: float, kind: str
) -> tuple[FloatArray, FloatArray]:
    """`tiny`: 10 mrad at up to 0.5 Hz; `slow`: below 0.05 rad/s; `still`: one joint never moves."""
    period = given.controller.period
    time = np.arange(round(seconds / period)) * period
    if kind == "still":
        position, _ = rich_motion(given, rng, seconds)
        still = rng.integers(len(given.joints))
        position[:, still] = given.centre[still]
        return position, np.gradient(position, period, axis=0)
    pulsation = {"tiny": 2.0 * np.pi * np.array([0.13, 0.31, 0.5]), "slow": np.array([0.3, 0.5])}
    size = {"tiny": 0.006, "slow": 0.05}[kind]
    position = np.tile(given.centre, (len(time), 1))
    for j in range(len(given.joints)):
        phase = rng.uniform(0.0, 2.0 * np.pi, len(pulsation[kind]))
        wave = np.sin(pulsation[kind] * time[:, None] + phase).sum(axis=1)
        position[:, j] += size * _window(time, 0.0, seconds) * wave
    return position, np.gradient(position, period, axis=0)


def _window(time: FloatArray, start: float, stop: float) -> FloatArray:
    """One inside, zero outside, smooth (twice differentiable) over FADE seconds."""
    s = np.clip(np.minimum(time - start, stop - time) / FADE, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


def _sines(time: FloatArray, rng: np.random.Generator, room: float, fastest: float) -> FloatArray:
    phase = rng.uniform(0.0, 2.0 * np.pi, len(PULSATIONS))
    size = rng.rayleigh(1.0, len(PULSATIONS)) / PULSATIONS**0.6
    wave = (size * np.sin(PULSATIONS * time[:, None] + phase)).sum(axis=1)
    slope = (size * PULSATIONS * np.cos(PULSATIONS * time[:, None] + phase)).sum(axis=1)
    return wave * min(0.9 * room / np.abs(wave).max(), 0.6 * fastest / np.abs(slope).max())


def _triangle(time: FloatArray, frequency: float, phase: float) -> FloatArray:
    """Triangle wave between -1 and 1 with corners rounded over 4 % of its period."""
    return np.arcsin(0.995 * np.sin(2.0 * np.pi * frequency * time + phase)) * 2.0 / np.pi


def _slow_sweeps(time: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Creeping at 0.03 to 0.2 rad/s, with small reversals on top."""
    speed, frequency = rng.uniform(0.05, 0.2), rng.uniform(0.25, 0.5)
    size = speed / (4.0 * frequency)
    small = _triangle(time, rng.uniform(1.1, 1.9), rng.uniform(0.0, 6.3))
    return size * _triangle(time, frequency, rng.uniform(0.0, 6.3)) + 0.012 * small


def _ramps(time: FloatArray, rng: np.random.Generator, room: float, fastest: float) -> FloatArray:
    """Constant speed there and back, 0.2 to 0.45 of the fastest."""
    speed = rng.uniform(0.2, 0.45) * fastest
    size = min(0.8 * room, speed / (4.0 * rng.uniform(0.3, 0.5)))
    return size * _triangle(time, speed / (4.0 * size), rng.uniform(0.0, 6.3))


def _chirp(
    time: FloatArray, rng: np.random.Generator, start: float, stop: float, fastest: float
) -> FloatArray:
    """0.7 to 7 Hz; the amplitude falls so that neither speed nor acceleration grows."""
    s = np.clip((time - start) / max(stop - start, 1e-9), 0.0, 1.0)
    low, high = rng.uniform(0.6, 0.9), rng.uniform(5.0, 8.0)
    frequency = low * (high / low) ** s
    phase = 2.0 * np.pi * np.cumsum(frequency) * (time[1] - time[0]) + rng.uniform(0.0, 6.3)
    pulsation = 2.0 * np.pi * frequency
    return 0.12 * fastest / pulsation * (low / frequency) ** 0.5 * np.sin(phase)
