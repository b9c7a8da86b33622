"""The list of cells: which robot, which effects at which ratio, which recordings."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from benchmarks.withheld_effects.effects import OUTSIDE, PARAMETRIC, STRUCTURAL
from benchmarks.withheld_effects.robot import given_robot

MASTER_SEED = 20250917
RATIOS = (0.3, 0.6, 1.0, 2.0, 4.0)
# The last four are known to look alike.
PAIRS = (
    ("stribeck", "position_ripple"),
    ("load_dependent_friction", "time_delay"),
    ("nonlinear_viscous", "position_ripple"),
    ("asymmetric_friction", "stribeck"),
    ("joint_coupling", "position_ripple"),
    ("elasticity", "nonlinear_viscous"),
    ("friction_drift", "load_dependent_friction"),
    ("presliding", "nonlinear_viscous"),
    ("spring", "stribeck"),
    ("torque_saturation", "position_dependent_friction"),
    ("backlash", "nonlinear_viscous"),
    ("stribeck", "presliding"),
    ("load_dependent_friction", "position_dependent_friction"),
    ("elasticity", "time_delay"),
    ("asymmetric_friction", "nonlinear_viscous"),
)


@dataclass(frozen=True)
class Asked:
    """An effect to be built in: name, joint from 0, wanted ratio to the noise floor."""

    effect: str
    joint: int
    rho: float


@dataclass(frozen=True)
class Cell:
    """One session of one true robot.

    Attributes
    ----------
    index : int
        Place in the list; seeds everything together with the master seed.
    group : str
        single, pair, none, parametric, outside, poor, coloured, jitter, without.
    robot : str
    altered : bool
        Whether all parameters are 10 to 30 % off the given ones.
    effects : tuple of Asked
    seconds : float
        Of each of three recordings: one motion twice, then another.
    motion : str
        "rich", or what is poor about it: "tiny", "slow", "still".
    colour : float
        Pole of the torque noise; 0: white.
    jitter : float
        s, standard deviation of the stamps.
    without : str or None
        Effect that the diagnosis is to leave out of its catalogue.
    fast : bool
        Belongs to the fast subset.
    """

    index: int
    group: str
    robot: str
    altered: bool
    effects: tuple[Asked, ...] = ()
    seconds: float = 15.0
    motion: str = "rich"
    colour: float = 0.0
    jitter: float = 0.0
    without: str | None = None
    fast: bool = False


@dataclass
class _List:
    rng: np.random.Generator
    cells: list[Cell] = field(default_factory=list)

    def add(
        self, group: str, robot: str, altered: bool, *effects: Asked, fast: bool = False, **other
    ) -> None:
        seconds = float(self.rng.integers(10, 17) if robot == "arm2" else self.rng.integers(17, 21))
        self.cells.append(
            Cell(
                len(self.cells),
                group,
                robot,
                altered,
                effects,
                seconds=seconds,
                fast=fast,
                **other,
            )
        )


def all_cells(master: int = MASTER_SEED) -> tuple[Cell, ...]:
    """Every cell of the full benchmark, in the order of its groups."""
    cells = _List(np.random.default_rng(master))
    _arm2(cells)
    for robot in ("arm6", "arm7"):
        _more_joints(cells, robot)
    return tuple(cells.cells)


def chosen_cells(subset: str, master: int = MASTER_SEED) -> tuple[Cell, ...]:
    """`full`, `fast`, or `families`: the first of each family in `fast` (KeyError: another)."""
    cells = all_cells(master)
    fast = tuple(cell for cell in cells if cell.fast)
    firsts = {family(cell): cell for cell in reversed(fast)}
    families = tuple(cell for cell in fast if cell is firsts[family(cell)])
    return {"full": cells, "fast": fast, "families": families}[subset]


def family(cell: Cell) -> str:
    """Group of a cell; with a single effect what that acts on: friction, transmission, actuation.

    That is the module which draws it.
    """
    if cell.group != "single":
        return cell.group
    return STRUCTURAL[cell.effects[0].effect].__module__.rpartition(".")[2]


def _arm2(cells: _List) -> None:
    rng = cells.rng
    for place, name in enumerate(STRUCTURAL):
        for step, rho in enumerate(RATIOS):
            for joint in (0, 1):
                fast = rho == 2.0 and joint == place % 2
                altered = (place + step + joint) % 4 != 0
                cells.add("single", "arm2", altered, Asked(name, joint, rho), fast=fast)
    for number in range(100):
        cells.add("none", "arm2", False, fast=number < 10)
    for number in range(20):
        cells.add("none", "arm2", True, fast=number < 2)
    for place, names in enumerate(PAIRS):
        first = int(rng.integers(2))
        # Look-pairs share a joint; of the others every second pair does.
        second = first if place >= len(PAIRS) - 4 or place % 2 else 1 - first
        wanted = rng.choice([1.0, 1.5, 2.0, 3.0], 2)
        asked = [
            Asked(name, joint, float(rho))
            for name, joint, rho in zip(names, (first, second), wanted, strict=True)
        ]
        cells.add("pair", "arm2", bool(place % 3), *asked, fast=place < 2)
    for place, name in enumerate(PARAMETRIC):
        for rho in (0.6, 1.0, 2.0, 4.0):
            joint = int(rng.integers(2))
            fast = rho == 4.0 and place % 2 == 0
            cells.add("parametric", "arm2", False, Asked(name, joint, rho), fast=fast)
    for name in OUTSIDE:
        for rho in (1.0, 2.0, 4.0):
            for joint in (0, 1):
                fast = rho == 2.0 and joint == 0
                cells.add("outside", "arm2", bool(joint), Asked(name, joint, rho), fast=fast)
    _disturbed(cells)
    for name in STRUCTURAL:
        asked = Asked(name, int(rng.integers(2)), 2.0)
        cells.add("without", "arm2", bool(rng.integers(2)), asked, without=name)
    # So that an effect that is left out does not tell that it is there.
    for name in rng.permutation(list(STRUCTURAL))[:8]:
        cells.add("none", "arm2", False, without=str(name))


def _disturbed(cells: _List) -> None:
    """Motions too poor to tell, coloured noise, uneven stamps; half of them with no effect."""
    rng = cells.rng
    names = ("stribeck", "elasticity", "load_dependent_friction", "position_ripple", "time_delay")
    for motion in ("tiny", "slow", "still"):
        for name in rng.permutation(names)[:3]:
            asked = Asked(str(name), int(rng.integers(2)), 2.0)
            cells.add("poor", "arm2", False, asked, motion=motion, fast=motion == "tiny")
        cells.add("poor", "arm2", False, motion=motion)
    for number in range(16):
        effects = ()
        if number % 2:
            effects = (Asked(str(rng.choice(list(STRUCTURAL))), int(rng.integers(2)), 1.0),)
        colour = float(rng.uniform(0.9, 0.985))
        cells.add("coloured", "arm2", bool(number % 4), *effects, colour=colour, fast=number == 0)
        jitter = float(rng.uniform(0.05e-3, 0.2e-3))
        cells.add("jitter", "arm2", bool(number % 4), *effects, jitter=jitter, fast=number == 0)


def _more_joints(cells: _List, robot: str) -> None:
    rng = cells.rng
    joints = len(given_robot(robot).joints)
    for name, rho in _single_on_many(robot):
        asked = Asked(name, int(rng.integers(joints)), rho)
        cells.add("single", robot, bool(rng.integers(4)), asked)
    for number in range(8):
        cells.add("none", robot, number >= 6)
    for names in (("stribeck", "time_delay"), ("nonlinear_viscous", "load_dependent_friction")):
        asked = [Asked(name, int(rng.integers(joints)), 2.0) for name in names]
        cells.add("pair", robot, True, *asked)
    for name in PARAMETRIC:
        cells.add("parametric", robot, False, Asked(name, int(rng.integers(joints)), 3.0))
    for name in ("contact_pulses", "random_bursts"):
        cells.add("outside", robot, False, Asked(name, int(rng.integers(joints)), 3.0))


def _single_on_many(robot: str) -> Iterator[tuple[str, float]]:
    for place, name in enumerate(STRUCTURAL):
        yield name, (1.0, 2.0)[place % 2]
        if robot == "arm6":
            yield name, (4.0, 0.6)[place % 2]
