"""The bags and the nominal model of a cell."""

from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.payload.cells import HAND, Cell
from benchmarks.payload.plants import Plant, record
from benchmarks.payload.robots import LOAD_CENTRE, Robot, data_sheet, fitted, off, with_body
from idim_iv_ros.configuration import Configuration
from idim_iv_ros.excitation import Trajectory, random_motion

SECONDS = {"arm2": 15.0, "arm6": 20.0, "arm7": 12.0}
RATE = 1000.0
_SEED = 4100


@cache
def motion(arm: str, seed: int) -> Trajectory:
    """Motion of an arm, the same in all its cells."""
    configuration = data_sheet(arm).configuration
    return random_motion(configuration, duration=SECONDS[arm], rate=RATE, seed=seed)


def session(cell: Cell, number: int, folder: Path) -> tuple[list[Path], Configuration]:
    """Make bags and nominal model of a cell; `number` seeds what is random in its robot."""
    folder.mkdir(parents=True, exist_ok=True)
    random = np.random.default_rng(_SEED + number)
    sheet = data_sheet(cell.arm)
    robot = off(sheet, _SEED + number, folder / "robot.urdf")
    joints = len(sheet.configuration.robot.joints)
    unknown = 1.0 + cell.gains * random.uniform(-1.0, 1.0, joints)
    plain = Plant(robot, cell.friction, unknown)
    nominal = sheet
    if cell.nominal == "fitted":
        unloaded = [folder / f"unloaded-{seed}.mcap" for seed in (11, 12)]
        for seed, bag in zip((11, 12), unloaded, strict=True):
            record(cell.plant, plain, cell.arm, motion(cell.arm, seed), seed, bag)
        nominal = fitted(sheet, unloaded, folder / "nominal.urdf")
    if cell.hand:
        nominal = with_body(nominal, *HAND, folder / "with_hand.urdf")
    factors = unknown.copy()
    if cell.gain is not None:
        factors[cell.gain[0]] *= cell.gain[1]
    bags = []
    for seed, loaded in zip((1, 2), cell.loaded, strict=True):
        own = _loaded(robot, cell, folder) if loaded and cell.mass else robot
        plant = Plant(own, cell.friction, factors, cell.tilt)
        bags.append(folder / f"{seed}.mcap")
        record(cell.plant, plant, cell.arm, motion(cell.arm, seed), seed, bags[-1])
    return bags, nominal.configuration


def _loaded(robot: Robot, cell: Cell, folder: Path) -> Robot:
    return with_body(robot, cell.mass, LOAD_CENTRE[cell.arm], folder / "loaded.urdf")
