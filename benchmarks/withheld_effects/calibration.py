"""Strength of an effect such that it stands out of the noise floor by a wanted ratio.

rho = sqrt(sigma² / sigma_n² - 1) at the joint of the effect, where sigma² is the variance of the
residual with the effect and sigma_n² that of the same robot, motion and noise without it. The
residual is that of the best rigid model fitted to these recordings ("refit", see
`residual_variance`), of the nominal model for causes that a refit absorbs ("given"), of the
recorded effort less the configured control law for another controller ("command").
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld_effects.effects import Effect
from benchmarks.withheld_effects.rigid_fit import filtered, given_variance, residual_variance
from benchmarks.withheld_effects.robot import given_inertials
from benchmarks.withheld_effects.world import Record, Runaway, World, record

FloatArray = NDArray[np.float64]
TRIALS = 12


@dataclass(frozen=True)
class Course:
    """One reference, (n_periods, n_joints) rad and rad/s, and the seed of its recording's noise."""

    position: FloatArray
    velocity: FloatArray
    seed: int


@dataclass(frozen=True)
class Calibrated:
    """Strength, the ratio that it gives, and whether that is the wanted one."""

    strength: float
    rho: float
    reached: bool


def session(world: World, courses: Sequence[Course]) -> list[Record]:
    """Recordings one after the other: what warmed up stays warm.

    Raises
    ------
    Runaway
        See `record`.
    """
    heat = np.zeros(len(world.given.joints))
    records = []
    for course in courses:
        records.append(record(world, course.position, course.velocity, course.seed, heat))
        heat *= world.warmth_kept
    return records


def variance(world: World, records: Sequence[Record], measure: str) -> FloatArray:
    """Residual variance (n_joints,) in (N m)² of recordings, by what `Effect.measure` names."""
    motion = filtered(world.given, records)
    if measure == "given":
        return given_variance(world.given, given_inertials(world.given), motion)
    if measure == "command":
        return np.asarray(motion.command_error.var(axis=0))
    return residual_variance(world.given, motion, world.sensors.torque)


def ratio(with_effect: FloatArray, without: FloatArray) -> FloatArray:
    """Rho of every joint; 0 where the residual did not grow."""
    return np.sqrt(np.maximum(with_effect / without - 1.0, 0.0))


def calibrate(
    world: World,
    effect: Effect,
    courses: Sequence[Course],
    without: Sequence[Record],
    rho: float,
    tolerance: float = 0.07,
) -> Calibrated:
    """Find the strength at which `effect.seen_at` shows `rho`.

    Bracketed secant steps on the logarithms; `without` are the recordings of these courses
    without the effect, with the same noise. Where the effect cannot show as much, the largest
    that it showed. An effect whose usual strength is its largest keeps that.
    """
    joint = effect.seen_at
    floor = variance(world, without, effect.measure)

    def shown(strength: float) -> float:
        try:
            records = session(effect.apply(world, strength), courses)
        except Runaway:
            return np.inf
        return float(ratio(variance(world, records, effect.measure), floor)[joint])

    if effect.usual == effect.largest:
        return Calibrated(effect.usual, shown(effect.usual), True)
    low, high = None, None
    strength = min(effect.usual * rho, effect.largest)
    best = Calibrated(0.0, 0.0, False)
    for _ in range(TRIALS):
        reached_ratio = shown(strength)
        if abs(reached_ratio / rho - 1.0) < tolerance:
            return Calibrated(strength, reached_ratio, True)
        if np.isfinite(reached_ratio) and abs(reached_ratio - rho) < abs(best.rho - rho):
            best = Calibrated(strength, reached_ratio, False)
        if reached_ratio < rho:
            low = (strength, max(reached_ratio, 0.02))
        else:
            high = (strength, min(reached_ratio, 1e3 * rho))
        if high is None:
            if strength >= effect.largest:
                break
            strength = min(strength * float(np.clip(rho / low[1], 1.2, 4.0)), effect.largest)
        elif low is None:
            strength *= float(np.clip(rho / high[1], 0.1, 0.85))
        else:
            strength = _between(low, high, rho)
    near = abs(best.rho / rho - 1.0) < 0.15
    return Calibrated(best.strength, best.rho, near)


def _between(low: tuple[float, float], high: tuple[float, float], rho: float) -> float:
    """Secant on the logarithms, kept off the ends of the bracket."""
    share = np.log(rho / low[1]) / np.log(high[1] / low[1])
    share = np.clip(share, 0.1, 0.9)
    return float(low[0] * (high[0] / low[0]) ** share)
