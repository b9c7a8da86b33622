"""From a cell to its recordings and to what is true of them."""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.withheld_effects.calibration import (
    Calibrated,
    Course,
    calibrate,
    ratio,
    session,
    variance,
)
from benchmarks.withheld_effects.cells import Cell
from benchmarks.withheld_effects.effects import EFFECTS, PARAMETRIC, STRUCTURAL, Effect
from benchmarks.withheld_effects.motion import poor_motion, rich_motion
from benchmarks.withheld_effects.robot import GivenRobot, given_robot
from benchmarks.withheld_effects.world import FloatArray, Record, Runaway, World, plain_world

REACHED = 0.15
PAUSE = 5.0  # s between two recordings


@dataclass(frozen=True)
class Session:
    """Three recordings with the instants at which they start (s), and their label."""

    records: tuple[Record, ...]
    starts: tuple[float, ...]
    label: dict


def make_session(cell: Cell, master: int) -> Session:
    """Draw the true robot of a cell, calibrate its effects, record it.

    The same cell and master seed give the same session on every run. Where a pair cannot be
    held in closed loop, both are weakened until it can; the label says the ratios that came out.
    """
    given = given_robot(cell.robot)
    seeds = np.random.SeedSequence([master, cell.index]).spawn(4)
    robot, motion, shape, noise = (np.random.default_rng(seed) for seed in seeds)
    world = plain_world(given, robot, altered=cell.altered)
    world = replace(world, sensors=replace(world.sensors, colour=cell.colour, jitter=cell.jitter))
    rich, courses = _courses(cell, given, motion, noise)
    drawn = [EFFECTS[asked.effect](shape, given, asked.joint) for asked in cell.effects]
    floor = session(world, courses)
    rich_floor = floor if rich is courses else session(world, rich)
    calibrated = [
        calibrate(world, effect, rich[::every], rich_floor[::every], asked.rho)
        for effect, asked in zip(drawn, cell.effects, strict=True)
        # Where a repeat differs by its noise alone, one of the two will do.
        for every in (1 if effect.whole_session else 2,)
    ]
    records, strengths = _recorded(world, drawn, calibrated, courses) if drawn else (floor, [])
    label = {
        "group": cell.group,
        "robot": cell.robot,
        "altered": cell.altered,
        "motion": cell.motion,
        "without": cell.without,
        "seconds": cell.seconds,
        "effects": [],
        "residual_rms": {
            "with": _rms(world, records),
            "without": _rms(world, floor),
        },
    }
    for asked, effect, strength in zip(cell.effects, drawn, strengths, strict=True):
        before = variance(world, floor, effect.measure)
        shown = ratio(variance(world, records, effect.measure), before)
        alone = shown
        if len(drawn) > 1:
            single = session(effect.apply(world, strength), courses)
            alone = ratio(variance(world, single, effect.measure), before)
        rho = float(alone[effect.seen_at])
        label["effects"].append(
            {
                "effect": effect.name,
                "kind": _kind(effect.name),
                "joint": None if effect.joint is None else given.joints[effect.joint],
                "joints": [given.joints[j] for j in effect.joints],
                "rho_wanted": asked.rho,
                "rho": rho,
                "rho_of_joints": dict(zip(given.joints, map(float, shown), strict=True)),
                "reached": abs(rho / asked.rho - 1.0) <= REACHED,
                "strength": strength,
                "measure": effect.measure,
                "shape": effect.shape,
            }
        )
    starts = np.cumsum([0.0] + [cell.seconds + PAUSE] * (len(records) - 1)) + 100.0
    return Session(tuple(records), tuple(map(float, starts)), label)


def _courses(
    cell: Cell, given: GivenRobot, motion: np.random.Generator, noise: np.random.Generator
) -> tuple[list[Course], list[Course]]:
    """Rich courses, on which strengths are defined, and those that are recorded."""
    seeds = [int(seed) for seed in noise.integers(2**31, size=3)]
    first, other = (rich_motion(given, motion, cell.seconds) for _ in range(2))
    rich = [
        Course(*course, seed) for course, seed in zip((first, first, other), seeds, strict=True)
    ]
    if cell.motion == "rich":
        return rich, rich
    first, other = (poor_motion(given, motion, cell.seconds, cell.motion) for _ in range(2))
    poor = [
        Course(*course, seed) for course, seed in zip((first, first, other), seeds, strict=True)
    ]
    return rich, poor


def _recorded(
    world: World, drawn: list[Effect], calibrated: list[Calibrated], courses: list[Course]
) -> tuple[list[Record], list[float]]:
    strengths = [calibration.strength for calibration in calibrated]
    for _ in range(6):
        true = world
        for effect, strength in zip(drawn, strengths, strict=True):
            true = effect.apply(true, strength)
        try:
            return session(true, courses), strengths
        except Runaway:
            strengths = [0.7 * strength for strength in strengths]
    raise Runaway(" and ".join(effect.name for effect in drawn))


def _rms(world: World, records: list[Record]) -> dict[str, float]:
    """What the best rigid model leaves at every joint, N m."""
    left: FloatArray = np.sqrt(variance(world, records, "refit"))
    return dict(zip(world.given.joints, map(float, left), strict=True))


def _kind(name: str) -> str:
    if name in PARAMETRIC:
        return "parametric"
    return "structural" if name in STRUCTURAL else "outside"
