"""The list of cells: which robot and plant, which effects at which ratio, which lengths.

A cell's place in the list tells nothing, and every beginning of the list has all kinds of cells
in about the shares of the whole: what was run in that order may be judged before its end.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.hostile.robots import LARGE, SMALL, joint_count
from benchmarks.withheld_effects.cells import Asked
from benchmarks.withheld_effects.effects import OUTSIDE, PARAMETRIC, STRUCTURAL

# Cells of each kind in one round of the list; `single` and `parametric` of each effect.
ROUND = {"none": 102, "single": 6, "pair": 24, "payload": 20, "outside": 16, "parametric": 5}
# An effect in two forms has half as many cells again.
FORMS = {
    "load_dependent_friction": ("load_dependent_friction", "static_load_friction"),
    "friction_drift": ("friction_drift", "friction_drift_anew"),
}
RATIOS = (1.1, 4.5)
# The second plant is what MuJoCo steps: it has no shaft, no bristles and no pair of joints.
SECOND_LACKS = {"elasticity", "backlash", "presliding", "joint_coupling"}
FRICTIONS = ("load_dependent_friction", "static_load_friction", "stribeck")
LONG = 16  # one cell in so many has one recording of 40 to 60 s


@dataclass(frozen=True)
class HostileCell:
    """One session of one true robot.

    Attributes
    ----------
    index : int
        Place in the list; seeds everything together with the master seed.
    group : str
        none, single, pair, payload (beside friction), outside, parametric.
    robot : str
    plant : str
        ``time_stepping`` or ``mujoco``.
    effects : tuple of Asked
    seconds : tuple of float
        Of each recording.
    numbers_off : bool
        Every number of the nominal model is off; else all are right within 0.2 %.
    """

    index: int
    group: str
    robot: str
    plant: str
    effects: tuple[Asked, ...]
    seconds: tuple[float, ...]
    numbers_off: bool


def hostile_cells(count: int, master: int) -> tuple[HostileCell, ...]:
    """The first `count` cells of a seed's list."""
    rng = np.random.default_rng(master)
    cells: list[HostileCell] = []
    while len(cells) < count:
        cells += _one_round(rng, list(_kinds(rng)), len(cells))
    return tuple(cells[:count])


def _kinds(rng: np.random.Generator) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Group and effects of every cell of one round, kind by kind."""
    singles = [name for name in STRUCTURAL for _ in range(ROUND["single"]) if name not in FORMS]
    for forms in FORMS.values():
        singles += [name for name in forms for _ in range(3 * ROUND["single"] // 4)]
    singles += ["common_delay"] * ROUND["single"]
    frictions = [FRICTIONS[k % len(FRICTIONS)] for k in range(ROUND["payload"])]
    outside = [name for name in OUTSIDE for _ in range(ROUND["outside"] // len(OUTSIDE))]
    yield from (("none", ()) for _ in range(ROUND["none"]))
    yield from (("single", (name,)) for name in singles)
    yield from (("pair", names) for names in _pairs(rng))
    yield from (("payload", ("payload", name)) for name in frictions)
    yield from (("outside", (name,)) for name in outside)
    for name in PARAMETRIC:
        yield from (("parametric", (name,)) for _ in range(ROUND["parametric"]))


def _pairs(rng: np.random.Generator) -> list[tuple[str, str]]:
    """Two effects each; every effect comes as often as any other."""
    names: list[str] = []
    while len(names) < 2 * ROUND["pair"]:
        names += [str(name) for name in rng.permutation(list(STRUCTURAL))]
    halves = zip(names[0::2], names[1::2], strict=False)
    pairs = [(first, second) for first, second in halves if first != second]
    return pairs[: ROUND["pair"]]


def _one_round(
    rng: np.random.Generator, drafts: list[tuple[str, tuple[str, ...]]], start: int
) -> list[HostileCell]:
    kinds: dict[tuple[str, tuple[str, ...]], list[int]] = {}
    for place, draft in enumerate(drafts):
        # Pairs are one kind, whatever their effects.
        key = draft if draft[0] != "pair" else ("pair", ())
        kinds.setdefault(key, []).append(place)
    order = np.empty(len(drafts))
    small, second, off = np.zeros((3, len(drafts)), dtype=bool)
    for turn, places in enumerate(kinds.values()):
        size = len(places)
        order[places] = (np.arange(size) + rng.random(size)) / size
        small[rng.permutation(places)[: (size + turn % 4) // 4]] = True
        second[rng.permutation(places)[: (size + turn % 3) // 3]] = True
        off[rng.permutation(places)[: (size + turn % 2) // 2]] = True
    stock: dict[bool, list[str]] = {True: [], False: []}
    cells = []
    for number, place in enumerate(np.argsort(order)):
        group, names = drafts[place]
        two = bool(small[place])
        stock[two] = stock[two] or [str(arm) for arm in rng.permutation(SMALL if two else [*LARGE])]
        arm = stock[two].pop()
        cells.append(
            HostileCell(
                index=start + number,
                group=group,
                robot=arm,
                plant="mujoco"
                if second[place] and not SECOND_LACKS & {*names}
                else "time_stepping",
                effects=_asked(rng, group, names, joint_count(arm)),
                seconds=_lengths(rng, long=number % LONG == LONG // 2),
                numbers_off=bool(off[place]) and group not in ("payload", "parametric"),
            )
        )
    return cells


def _lengths(rng: np.random.Generator, *, long: bool) -> tuple[float, ...]:
    """Two recordings of about 10 s, or one of about 15 s; now and then one that is long."""
    if long:
        return (float(np.round(rng.uniform(40.0, 60.0), 1)),)
    if rng.random() < 0.6:
        return tuple(float(seconds) for seconds in np.round(rng.uniform(10.0, 11.0, 2), 1))
    return (float(np.round(rng.uniform(12.0, 18.0), 1)),)


def _asked(
    rng: np.random.Generator, group: str, names: tuple[str, ...], joints: int
) -> tuple[Asked, ...]:
    if group == "payload":
        # Friction where a payload is felt.
        loaded = 0 if joints == 2 else int(rng.integers(1, 3))
        friction = Asked(names[1], loaded, float(rng.uniform(1.0, 3.0)))
        return Asked("payload", joints - 1, float(rng.uniform(2.0, 8.0))), friction
    asked = []
    for name in names:
        # A joint that turns about the vertical, or a last one, carries no load to speak of.
        carries = name in FORMS["load_dependent_friction"] and joints > 2
        joint = int(rng.integers(1, 4) if carries else rng.integers(joints))
        asked.append(Asked(name, joint, float(np.exp(rng.uniform(*np.log(RATIOS))))))
    return tuple(asked)
