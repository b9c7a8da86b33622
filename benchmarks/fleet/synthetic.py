"""Results of bags without bags: R factors drawn from the distribution that a fleet has.

The R factor of n rows [X y] with y = Xβ + e, e of variance one, is that of X, beside it R_X β plus
p standard normal numbers, and below these the root of a χ² with n − p degrees of freedom.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone

import numpy as np
import scipy

from benchmarks.fleet.arms import TYPE, FloatArray
from idim_iv_ros.fleet.result import BagResult, JointNoise

NAMES = tuple(TYPE)
MEAN = np.array([mean for mean, _ in TYPE.values()])
SIGMA = np.array([sigma for _, sigma in TYPE.values()])
JOINTS = ("joint_1", "joint_2")
_UNITS = {"Fv": "N m s/rad", "Fc": "N m", "off": "N m", "MX": "kg m", "MZ": "kg m"}


@dataclass(frozen=True)
class Drawn:
    """How a fleet is drawn; deviations in units of the robot-to-robot one.

    Attributes
    ----------
    noise : (2,)
        Range of the deviation of a bag's estimates.
    between_bags
        What bags of a robot differ by beyond it.
    residual
        Relative, from robot to robot; a third of it from bag to bag.
    """

    robots: int = 12
    bags: int = 6
    noise: tuple[float, float] = (0.2, 0.6)
    between_bags: float = 0.3
    residual: float = 0.1
    rows: int = 800
    # (robot, name or joint of a residual): added in units of SIGMA; for residuals to the logarithm.
    planted: Mapping[tuple[int, str], float] = field(default_factory=dict)
    # (robot, name): size of each bag, in units of SIGMA.
    drifting: Mapping[tuple[int, str], Sequence[float]] = field(default_factory=dict)
    type: str = "arm2"


def fleet(drawn: Drawn, random: np.random.Generator) -> tuple[list[BagResult], FloatArray]:
    """Results of all bags, and the true parameters (robots, p) without what drifts."""
    truths = MEAN + SIGMA * random.standard_normal((drawn.robots, len(NAMES)))
    results = []
    for robot in range(drawn.robots):
        for column, name in enumerate(NAMES):
            truths[robot, column] += SIGMA[column] * drawn.planted.get((robot, name), 0.0)
        levels = np.log(0.3) + drawn.residual * random.standard_normal(len(JOINTS))
        levels = levels + [drawn.planted.get((robot, joint), 0.0) for joint in JOINTS]
        for bag in range(drawn.bags):
            values = truths[robot] + drawn.between_bags * SIGMA * random.standard_normal(len(NAMES))
            for column, name in enumerate(NAMES):
                change = drawn.drifting.get((robot, name))
                values[column] += SIGMA[column] * change[bag] if change is not None else 0.0
            noise = np.exp(levels + drawn.residual / 3.0 * random.standard_normal(len(JOINTS)))
            results.append(_result(drawn, random, robot, bag, values, noise))
    return results, truths


def bag_factor(
    values: FloatArray, deviations: FloatArray, rows: int, random: np.random.Generator
) -> FloatArray:
    """R factor of a bag with these true parameters and these deviations of its estimates."""
    width = len(values)
    upper = np.linalg.qr(random.standard_normal((4 * width, width)), mode="r")
    spread = np.linalg.norm(scipy.linalg.solve_triangular(upper, np.eye(width)), axis=1)
    upper = upper * (spread / deviations)
    factor = np.zeros((width + 1, width + 1))
    factor[:width, :width] = upper
    factor[:width, width] = upper @ values + random.standard_normal(width)
    factor[width, width] = np.sqrt(random.chisquare(rows - width))
    return factor


def _result(
    drawn: Drawn,
    random: np.random.Generator,
    robot: int,
    bag: int,
    values: FloatArray,
    noise: FloatArray,
) -> BagResult:
    deviations = SIGMA * random.uniform(*drawn.noise)
    factor = bag_factor(values, deviations, drawn.rows, random)
    when = datetime(2026, 1, 5, 8, 0, tzinfo=timezone.utc) + timedelta(days=7 * bag)
    name = f"{drawn.type}-{robot + 1:03d}"
    solved = scipy.linalg.solve_triangular(factor[:-1, :-1], factor[:-1, -1])
    return BagResult(
        uri=f"{name}/{bag + 1:02d}.mcap",
        content=f"{name}-{bag}",
        robot=name,
        type=drawn.type,
        time=when.strftime("%Y-%m-%dT%H:%M:%SZ"),
        status="ok",
        duration=20.0,
        names=NAMES,
        expressions=NAMES,
        units=tuple(_UNITS.get(name.rstrip("12"), "kg m²") for name in NAMES),
        r_factor=factor,
        rows=drawn.rows,
        noise=tuple(JointNoise(j, float(n), 0.1) for j, n in zip(JOINTS, noise, strict=True)),
        values=tuple(map(float, solved)),
        std=tuple(map(float, deviations)),
        given=tuple(map(float, MEAN)),
    )
