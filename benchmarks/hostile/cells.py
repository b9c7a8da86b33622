"""The list of cells: which robot and plant, which effects at which ratio, which lengths."""

from dataclasses import dataclass

import numpy as np

from benchmarks.withheld_effects.cells import Asked
from benchmarks.withheld_effects.effects import OUTSIDE, PARAMETRIC, STRUCTURAL
from benchmarks.withheld_effects.robot import given_robot

# Cells of each group in every twenty.
SHARES = {"none": 5, "single": 7, "pair": 2, "outside": 2, "payload": 2, "parametric": 2}
LARGE, OWN_PLANT = 3, 5  # one cell in so many has 6 or 7 joints, runs in MuJoCo's own plant
RATIOS = (0.6, 4.0)
# The second plant is what MuJoCo steps: it has no shaft, no bristles and no pair of joints.
SECOND_LACKS = {"elasticity", "backlash", "presliding", "joint_coupling"}
FRICTIONS = ("load_dependent_friction", "stribeck")


@dataclass(frozen=True)
class HostileCell:
    """One session of one true robot.

    Attributes
    ----------
    index : int
        Place in the list; seeds everything together with the master seed.
    group : str
        none, single, pair, outside, payload (beside friction), parametric.
    robot : str
    plant : str
        ``time_stepping`` or ``mujoco``.
    effects : tuple of Asked
    seconds : tuple of float
        Of each recording.
    without : None
        No effect is left out of the catalogue.
    """

    index: int
    group: str
    robot: str
    plant: str
    effects: tuple[Asked, ...]
    seconds: tuple[float, ...]
    without: None = None

    @property
    def identified(self) -> bool:
        """Whether the nominal model was fitted to the robot before one number changed."""
        return self.group in ("payload", "parametric")


def hostile_cells(count: int, master: int) -> tuple[HostileCell, ...]:
    """`count` cells of a seed; of another count with the same seed they are others."""
    rng = np.random.default_rng([master, count])
    turn = [str(group) for group, share in SHARES.items() for _ in range(share)]
    # Every twenty cells hold each group as often as its share says.
    rounds = [rng.permutation(turn) for _ in range(-(-count // len(turn)))]
    groups = [str(group) for group in np.concatenate(rounds)[:count]]
    large = rng.permutation([k % LARGE == 0 for k in range(count)])
    own = rng.permutation([k % OWN_PLANT == 0 for k in range(count)])
    left: dict[str, list[str]] = {}
    cells = []
    for index, group in enumerate(groups):
        robot = str(rng.choice(["arm6", "arm7"])) if large[index] else "arm2"
        plant = "mujoco" if own[index] else "time_stepping"
        cells.append(
            HostileCell(
                index,
                group,
                robot,
                plant,
                _effects(rng, group, robot, plant, left),
                _lengths(rng, robot),
            )
        )
    return tuple(cells)


def _lengths(rng: np.random.Generator, robot: str) -> tuple[float, ...]:
    """Three recordings of about 12 s; two of about 11 s where there are more joints."""
    middle, count = (12.0, 3) if robot == "arm2" else (11.0, 2)
    return tuple(float(each) for each in np.round(middle * rng.uniform(0.75, 1.25, count), 1))


def _effects(
    rng: np.random.Generator, group: str, robot: str, plant: str, left: dict[str, list[str]]
) -> tuple[Asked, ...]:
    joints = len(given_robot(robot).joints)

    def asked(name: str) -> Asked:
        ratio = float(np.exp(rng.uniform(*np.log(RATIOS))))
        return Asked(name, int(rng.integers(joints)), ratio)

    def next_of(names: list[str], number: int = 1) -> list[str]:
        """Names in turns: each comes as often as any other."""
        stock = left.setdefault(group, [])
        if len([name for name in stock if name in names]) < number:
            stock += [str(name) for name in rng.permutation(names)]
        taken: list[str] = []
        for name in list(stock):
            if name in names and name not in taken and len(taken) < number:
                taken.append(name)
                stock.remove(name)
        return taken

    structural = [name for name in STRUCTURAL if plant != "mujoco" or name not in SECOND_LACKS]
    if group == "single":
        return tuple(map(asked, next_of(structural)))
    if group == "pair":
        return tuple(map(asked, next_of(structural, 2)))
    if group == "outside":
        return tuple(map(asked, next_of(list(OUTSIDE))))
    if group == "parametric":
        return tuple(map(asked, next_of(list(PARAMETRIC))))
    if group == "payload":
        loaded = 0 if robot == "arm2" else int(rng.integers(1, 3))
        friction = Asked(next_of(list(FRICTIONS))[0], loaded, float(rng.uniform(0.8, 3.0)))
        return Asked("payload", joints - 1, float(rng.uniform(2.0, 8.0))), friction
    return ()
