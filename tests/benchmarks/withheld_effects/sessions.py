"""Short recordings of true robots for these tests."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from benchmarks.withheld_effects.calibration import Course
from benchmarks.withheld_effects.motion import rich_motion
from benchmarks.withheld_effects.robot import given_robot
from benchmarks.withheld_effects.world import World, plain_world


@lru_cache
def courses(robot: str, seconds: float, number: int = 2) -> tuple[Course, ...]:
    rng = np.random.default_rng(11)
    given = given_robot(robot)
    return tuple(Course(*rich_motion(given, rng, seconds), seed) for seed in range(number))


def world(robot: str = "arm2", *, altered: bool = True) -> World:
    return plain_world(given_robot(robot), np.random.default_rng(5), altered=altered)


def silent(world: World) -> World:
    none = np.zeros(len(world.given.joints))
    sensors = replace(world.sensors, position=none, velocity=none, torque=none, resolution=none)
    return replace(world, sensors=sensors)
