"""From a cell to its recordings and to what is true of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.hostile.cells import HostileCell
from benchmarks.hostile.loop import Chain
from benchmarks.hostile.nuisances import Nuisances, drawn
from benchmarks.hostile.plants import Run, chain_of, run
from benchmarks.hostile.robots import robot
from benchmarks.withheld_effects.calibration import (
    Calibrated,
    Course,
    calibrate,
    ratio,
    session,
    variance,
)
from benchmarks.withheld_effects.effects import EFFECTS, PARAMETRIC, STRUCTURAL, Effect
from benchmarks.withheld_effects.motion import rich_motion
from benchmarks.withheld_effects.robot import (
    GivenRobot,
    Inertials,
    altered_inertials,
    given_inertials,
)
from benchmarks.withheld_effects.sensors import Sensors
from benchmarks.withheld_effects.world import Record, Runaway, World, plain_world

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
        calibrated = _calibrated(world, effects, cell, motion)
        if all(calibration.reached for calibration in calibrated):
            break
    slower = _with_chain(given, nuisances)
    recorded = Recording(
        replace(world, controller=slower.controller),
        cell.plant,
        chain_of(nuisances, len(given.joints)),
        tuple(_motions(cell, nuisances, slower, motion)),
        tuple(noise.integers(2**31, size=len(cell.seconds)).tolist()),
    )
    acting = _effects(cell, slower, shape)
    runs, strengths = _recorded(
        recorded, acting, [calibration.strength for calibration in calibrated]
    )
    shown = _shown(recorded, acting, strengths, runs)
    sensors = recorded.of(acting, strengths).sensors
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
                "rho": calibration.rho * strength / calibration.strength
                if calibration.strength
                else 0.0,
                "reached": calibration.reached,
                "rho_recorded": there,
                "strength": strength,
                "mass": _mass(effect, world, strength),
                "shape": effect.shape,
            }
            for asked, effect, calibration, strength, there in zip(
                cell.effects, effects, calibrated, strengths, shown, strict=True
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
    told from; the delay of one joint where all have it, and any where loop or stamps are late by
    more than a period, which the configuration does not say.
    """
    anywhere, true = [], []
    if nuisances.nominal_error >= LEAST_ERROR:
        # Another last link is the given one with a payload.
        anywhere += ["link_inertia", "friction_level", "drive_inertia", "payload"]
    if not nuisances.knows_armature:
        anywhere.append("drive_inertia")
    late = nuisances.computing + nuisances.lateness + abs(nuisances.effort_offset)
    if late > nuisances.period:
        anywhere.append("time_delay")
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


@dataclass(frozen=True)
class Recording:
    """What the recordings of a cell are made of but for the effects.

    `motions` are references and `seeds` of the noise, one of either for a recording.
    """

    world: World
    plant: str
    chain: Chain
    motions: tuple[tuple[FloatArray, FloatArray], ...]
    seeds: tuple[int, ...]

    def of(self, effects: Sequence[Effect], strengths: Sequence[float]) -> World:
        """The true robot with effects."""
        true = self.world
        for effect, strength in zip(effects, strengths, strict=True):
            true = effect.apply(true, strength)
        return true

    def runs(self, true: World) -> list[Run]:
        """Simulate them on a true robot; what warmed up stays warm.

        Raises
        ------
        Runaway
            See `run`.
        """
        heat = np.zeros(len(true.given.joints))
        runs = []
        for motion, seed in zip(self.motions, self.seeds, strict=True):
            runs.append(run(true, self.plant, self.chain, motion, seed, heat))
            heat *= true.warmth_kept
        return runs


def _recorded(
    recording: Recording, effects: Sequence[Effect], strengths: list[float]
) -> tuple[list[Run], list[float]]:
    """Recordings, and the strengths with which the loop holds."""
    for _ in range(8):
        try:
            return recording.runs(recording.of(effects, strengths)), strengths
        except Runaway:
            strengths = [WEAKER * strength for strength in strengths]
    raise Runaway("the loop does not hold with weaker effects")


def _shown(
    recording: Recording,
    effects: Sequence[Effect],
    strengths: Sequence[float],
    runs: Sequence[Run],
) -> list[float | None]:
    """Ratio by which every effect stands out in the recordings themselves.

    Against the same motions and noise without that effect, by the fit of the calibration at the
    control period; None where the loop does not hold without it.
    """
    given = replace(recording.world.given, controller=recording.world.controller)
    slower = replace(recording.world, given=given)
    whole = _records(recording.of(effects, strengths), runs)
    out: list[float | None] = []
    for k, effect in enumerate(effects):
        others = [*effects[:k], *effects[k + 1 :]]
        true = recording.of(others, [*strengths[:k], *strengths[k + 1 :]])
        try:
            without = variance(slower, _records(true, recording.runs(true)), effect.measure)
        except Runaway:
            out.append(None)
            continue
        shown = ratio(variance(slower, whole, effect.measure), without)
        out.append(float(shown[effect.seen_at]))
    return out


def _records(true: World, runs: Sequence[Run]) -> list[Record]:
    """Runs with their efforts averaged over the control period that is centred on the stamp."""
    records = []
    for number, one in enumerate(runs):
        recorded, rng = one.recorded, np.random.default_rng(number)
        effort = recorded.applied.copy()
        effort[:-1] = 0.5 * (effort[:-1] + effort[1:])
        records.append(
            Record(
                time=np.arange(len(effort)) * true.controller.period,
                position=recorded.position,
                velocity=recorded.speed,
                effort=effort + true.sensors.torque * rng.normal(size=effort.shape),
                position_reference=one.position_reference,
                velocity_reference=one.velocity_reference,
                link=recorded.position,
                clean_effort=effort,
            )
        )
    return records


def _mass(effect: Effect, world: World, strength: float) -> float | None:
    """Of a payload, kg."""
    if effect.name != "payload":
        return None
    return float(effect.apply(world, strength).inertials.mass[-1] - world.inertials.mass[-1])


def _kind(name: str) -> str:
    if name in PARAMETRIC:
        return "parametric"
    return "structural" if name in STRUCTURAL else "outside"
