"""From a cell to its recordings and to what is true of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hostile.cells import HostileCell
from benchmarks.hostile.nuisances import Nuisances, drawn
from benchmarks.hostile.plants import Run, chain_of, run
from benchmarks.hostile.robots import robot
from benchmarks.withheld_effects.calibration import Calibrated, Course, calibrate, session
from benchmarks.withheld_effects.effects import EFFECTS, PARAMETRIC, STRUCTURAL, Effect
from benchmarks.withheld_effects.motion import rich_motion
from benchmarks.withheld_effects.robot import (
    GivenRobot,
    Inertials,
    altered_inertials,
    given_inertials,
)
from benchmarks.withheld_effects.sensors import Sensors
from benchmarks.withheld_effects.world import Runaway, World, plain_world

FloatArray = NDArray[np.float64]
SHIFT = 0.04  # m by which centres of mass are off, per relative error of the inertials
WEAKER = 0.7  # what strengths are multiplied with until the loop holds
LEAST_ERROR = 0.05
REDRAWN = 3  # times that shapes are drawn until the ratios can be reached
TRIAL, CLOSE = 10.0, 0.15  # s of a motion for calibration, and how near its ratio must come


@dataclass(frozen=True)
class HostileSession:
    """Recordings of one robot in the order of time, what records its efforts, and their label."""

    runs: tuple[Run, ...]
    nuisances: Nuisances
    given: GivenRobot
    sensors: Sensors
    label: dict[str, Any]


def make_session(cell: HostileCell, master: int) -> HostileSession:
    """Draw the true robot of a cell and its nuisances, calibrate its effects, record it.

    Strengths are found on the benchmark's own plant at its own period, on a motion of its own of
    TRIAL seconds, with the cell's sensors and no other nuisance: ρ is what the effect is, not what
    a poor signal chain hides of it.
    """
    seeds = np.random.SeedSequence([master, cell.index]).spawn(6)
    arm, body, noise, chain = (np.random.default_rng(seed) for seed in seeds[:4])
    given = robot(cell.robot, arm)
    motion = int(np.random.default_rng(seeds[4]).integers(2**31))
    nuisances = drawn(
        chain,
        given,
        identified=not cell.numbers_off,
        needs_law=any(asked.effect == "controller_mismatch" for asked in cell.effects),
    )
    world = _world(given, nuisances, body)
    for shape in seeds[5].spawn(REDRAWN):
        effects = _effects(cell, given, shape)
        found = _calibrated(world, effects, cell, motion)
        if all(each.reached for each in found):
            break
    slower = _with_chain(given, nuisances)
    runs, sensors, strengths = _recorded(
        cell,
        world,
        nuisances,
        _effects(cell, slower, shape),
        [each.strength for each in found],
        _motions(cell, nuisances, slower, motion),
        noise.integers(2**31, size=len(cell.seconds)).tolist(),
    )
    label = {
        "group": cell.group,
        "robot": cell.robot,
        "joints": len(given.joints),
        "plant": cell.plant,
        "seconds": list(cell.seconds),
        "numbers_off": cell.numbers_off,
        "nuisances": nuisances.document(),
        "also_true": also_true(nuisances, effects, given),
        "effects": [
            {
                "effect": effect.name,
                "form": asked.effect,
                "kind": _kind(effect.name),
                "joint": None if effect.joint is None else given.joints[effect.joint],
                "joints": [given.joints[j] for j in effect.joints],
                "rho_wanted": asked.rho,
                "rho": each.rho * strength / each.strength if each.strength else 0.0,
                "reached": each.reached,
                "strength": strength,
                "mass": _mass(effect, world, strength),
                "shape": effect.shape,
            }
            for asked, effect, each, strength in zip(
                cell.effects, effects, found, strengths, strict=True
            )
        ],
    }
    return HostileSession(tuple(runs), nuisances, given, sensors, label)


def _effects(cell: HostileCell, given: GivenRobot, seed: np.random.SeedSequence) -> list[Effect]:
    """Effects with the shapes of a seed, in the control periods of `given`."""
    shape = np.random.default_rng(seed)
    return [EFFECTS[asked.effect](shape, given, asked.joint) for asked in cell.effects]


def also_true(
    nuisances: Nuisances, effects: Sequence[Effect], given: GivenRobot
) -> list[dict[str, str | None]]:
    """Names that nobody asks for and that are not false, at one joint or (None) at any.

    What the errors of the nominal model make true; the offset that asymmetric friction cannot be
    told from; the delay of one joint where all have it.
    """
    anywhere, true = [], []
    if nuisances.nominal_error >= LEAST_ERROR:
        # Another last link is the given one with a payload.
        anywhere += ["link_inertia", "friction_level", "drive_inertia", "payload"]
    if not nuisances.knows_armature:
        anywhere.append("drive_inertia")
    for effect in effects:
        if effect.name == "time_delay" and effect.joint is None:
            anywhere.append("time_delay")
        if effect.name == "asymmetric_friction" and effect.joint is not None:
            true.append({"effect": "torque_offset", "joint": given.joints[effect.joint]})
    return true + [{"effect": name, "joint": None} for name in sorted(set(anywhere))]


def _world(given: GivenRobot, nuisances: Nuisances, rng: np.random.Generator) -> World:
    """The true robot: what the nominal model says, off by the nuisances."""
    world = plain_world(given, rng, altered=False)
    size = nuisances.nominal_error
    off = (min(LEAST_ERROR, 0.2 * size), size)
    inertials = altered_inertials(given_inertials(given), rng, off, SHIFT * size)
    n = len(given.joints)
    factors = 1.0 + rng.uniform(*off, (3, n)) * rng.choice([-1.0, 1.0], (3, n))
    drive = world.drive._replace(
        inertia=world.drive.inertia * factors[0],
        viscous_forward=given.viscous * factors[1],
        viscous_backward=given.viscous * factors[1],
        dry_forward=given.dry * factors[2],
        dry_backward=given.dry * factors[2],
        warm_dry=np.full(n, nuisances.warm_dry),
        warm_viscous=np.full(n, nuisances.warm_viscous),
        warm_time=np.full(n, nuisances.warm_time),
        warm_speed=0.25 * given.fastest,
    )
    return replace(
        world,
        inertials=_with_part(inertials, nuisances.part),
        drive=drive,
        sensors=nuisances.sensors(given),
    )


def _with_part(inertials: Inertials, part: float) -> Inertials:
    """The last link with a part that has its centre and shape, or without such a part."""
    mass, inertia = inertials.mass.copy(), inertials.inertia.copy()
    mass[-1] *= 1.0 + part
    inertia[-1] *= 1.0 + part
    return Inertials(mass, inertials.centre, inertia)


def _with_chain(given: GivenRobot, nuisances: Nuisances) -> GivenRobot:
    """The robot with the control period of the cell, and its gains."""
    law = given.controller
    return replace(
        given,
        controller=law._replace(
            period=nuisances.period,
            kp=law.kp * nuisances.softer**2,
            kd=law.kd * nuisances.softer,
            ki=law.ki * nuisances.softer**2,
        ),
    )


def _motions(
    cell: HostileCell, nuisances: Nuisances, given: GivenRobot, seed: int
) -> list[tuple[FloatArray, FloatArray]]:
    """References at the control period of `given`; the seed decides the motion, not the period."""
    same = nuisances.repeats
    return [
        rich_motion(
            given,
            np.random.default_rng([seed, 0 if same and k == 1 else k]),
            cell.seconds[0] if same and k == 1 else seconds,
        )
        for k, seconds in enumerate(cell.seconds)
    ]


def _calibrated(
    world: World, effects: Sequence[Effect], cell: HostileCell, motion: int
) -> list[Calibrated]:
    """Strengths at which the effects stand out by the ratios that are asked for."""
    if not effects:
        return []
    # What acts at few instants, or over a session, needs two recordings.
    count = 2 if any(effect.whole_session for effect in effects) else 1
    courses = [
        Course(*rich_motion(world.given, np.random.default_rng([motion, 2, k]), TRIAL), motion + k)
        for k in range(count)
    ]
    floor = session(world, courses)
    return [
        calibrate(world, effect, courses, floor, asked.rho, CLOSE)
        for effect, asked in zip(effects, cell.effects, strict=True)
    ]


def _recorded(
    cell: HostileCell,
    world: World,
    nuisances: Nuisances,
    effects: Sequence[Effect],
    strengths: list[float],
    motions: Sequence[tuple[FloatArray, FloatArray]],
    seeds: Sequence[int],
) -> tuple[list[Run], Sensors, list[float]]:
    """Recordings, what records their efforts, and the strengths with which the loop holds."""
    law = _with_chain(world.given, nuisances).controller
    plain = replace(world, controller=law)
    chain = chain_of(nuisances, len(world.given.joints))
    for _ in range(8):
        true = plain
        for effect, strength in zip(effects, strengths, strict=True):
            true = effect.apply(true, strength)
        heat = np.zeros(len(world.given.joints))
        runs = []
        try:
            for motion, seed in zip(motions, seeds, strict=True):
                runs.append(run(true, cell.plant, chain, motion, seed, heat))
                heat *= true.warmth_kept
        except Runaway:
            strengths = [WEAKER * strength for strength in strengths]
            continue
        return runs, true.sensors, strengths
    raise Runaway(f"{cell.group} on {cell.robot}")


def _mass(effect: Effect, world: World, strength: float) -> float | None:
    """Of a payload, kg."""
    if effect.name != "payload":
        return None
    return float(effect.apply(world, strength).inertials.mass[-1] - world.inertials.mass[-1])


def _kind(name: str) -> str:
    if name in PARAMETRIC:
        return "parametric"
    return "structural" if name in STRUCTURAL else "outside"
