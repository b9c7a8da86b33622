"""Repeats of a small fleet drawn as R factors: coverage of intervals, discoveries, dates."""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.fleet.synthetic import JOINTS, MEAN, NAMES, SIGMA, Drawn, fleet
from idim_iv_ros.fleet.fleet_result import fleet_result
from idim_iv_ros.fleet.result import FleetResult
from idim_iv_ros.statistics.change_points import change_of

ROBOTS, BAGS, PLANTED, DRIFTING = 30, 8, 3, 2
EFFECT = 6.0  # of a planted difference, robot-to-robot deviations
RESIDUAL = 6.0  # the same of a residual's logarithm
CHANGE = 3.0  # of a drift, robot-to-robot deviations: some ten of those from bag to bag


@dataclass
class Counts:
    """Of all repeats."""

    repeats: int = 0
    quantities: int = 0
    mean: int = 0
    sigma: int = 0
    ahead: int = 0
    robot_interval: int = 0
    robot_intervals: int = 0
    false_shares: list[float] = field(default_factory=list)
    detected: int = 0
    planted: int = 0
    false_change_shares: list[float] = field(default_factory=list)
    changed: int = 0
    drifting: int = 0
    dates: int = 0
    dates_in_interval: int = 0


def repeat(counts: Counts, seed: int, *, special: bool, robots: int, bags: int) -> None:
    """Draw one fleet and count what is right about it."""
    random = np.random.default_rng([seed, robots, bags, special])
    planted: dict[tuple[int, str], float] = {}
    drifting: dict[tuple[int, str], list[float]] = {}
    begins: dict[tuple[int, str], int] = {}
    if special:
        for robot in range(PLANTED):
            name = str(random.choice([*NAMES, *JOINTS]))
            size = RESIDUAL * 0.1 if name in JOINTS else EFFECT * random.choice([-1.0, 1.0])
            planted[robot, name] = float(size)
        for robot in range(PLANTED, PLANTED + DRIFTING):
            name = str(random.choice(NAMES))
            begin = int(random.integers(3, bags - 3))
            steps = np.arange(bags) - begin + 1.0
            shape = (steps > 0) * (1.0 if robot % 2 else np.maximum(steps, 0) / (bags - begin))
            drifting[robot, name] = list(CHANGE * (1.0 if robot % 2 else 2.0) * shape)
            begins[robot, name] = begin
    drawn = Drawn(robots=robots, bags=bags, planted=planted, drifting=drifting)
    results, truths = fleet(drawn, random)
    answer = fleet_result(results)
    counts.repeats += 1
    _intervals(counts, answer, truths, random)
    _discoveries(counts, answer, planted, begins)


def _intervals(
    counts: Counts, answer: FleetResult, truths: np.ndarray, random: np.random.Generator
) -> None:
    by_name = {robot.robot: robot for robot in answer.robots}
    for column, name in enumerate(NAMES):
        quantity = next(item for item in answer.types[0].quantities if item.name == name)
        counts.quantities += 1
        counts.mean += quantity.mean_low <= MEAN[column] <= quantity.mean_high
        counts.sigma += quantity.sigma_low <= SIGMA[column] <= quantity.sigma_high
        following = MEAN[column] + SIGMA[column] * random.standard_normal()
        counts.ahead += quantity.next_low <= following <= quantity.next_high
        for robot in range(len(truths)):
            measured = by_name[f"arm2-{robot + 1:03d}"].quantities[column]
            if not measured.changed:
                counts.robot_intervals += 1
                counts.robot_interval += measured.low <= truths[robot, column] <= measured.high


def _discoveries(
    counts: Counts,
    answer: FleetResult,
    planted: dict[tuple[int, str], float],
    begins: dict[tuple[int, str], int],
) -> None:
    odd = {f"arm2-{robot + 1:03d}" for robot, _ in planted}
    called = {robot.robot for robot in answer.robots if any(q.differs for q in robot.quantities)}
    counts.planted += len(odd)
    counts.detected += len(odd & called)
    counts.false_shares.append(len(called - odd) / max(len(called), 1))
    drifting = {f"arm2-{robot + 1:03d}": (name, b) for (robot, name), b in begins.items()}
    changed = {robot.robot for robot in answer.robots if robot.changes}
    counts.drifting += len(drifting)
    counts.changed += len(changed & set(drifting))
    counts.false_change_shares.append(len(changed - set(drifting)) / max(len(changed), 1))
    for robot in answer.robots:
        if robot.robot not in drifting:
            continue
        name, begin = drifting[robot.robot]
        for change in robot.changes:
            if change.name == name:
                place = change.times.index(change.begin)
                low, high = (change.times.index(t) for t in (change.begin_low, change.begin_high))
                counts.dates += abs(place - begin) <= 2
                counts.dates_in_interval += low <= begin <= high


def coverage(repeats: int, *, special: bool, robots: int = ROBOTS, bags: int = BAGS) -> Counts:
    """Count over so many fleets; `special`: with planted and drifting robots."""
    counts = Counts()
    for seed in range(repeats):
        repeat(counts, seed, special=special, robots=robots, bags=bags)
    return counts


def lines(repeats: int) -> list[str]:
    """Lines of the results page."""
    cases = [
        ("nobody differs", coverage(repeats, special=False)),
        ("with planted robots", coverage(repeats, special=True)),
        ("8 robots of 4 bags", coverage(repeats, special=False, robots=8, bags=4)),
    ]
    said = [
        f"{repeats} fleets a column, drawn as R factors; where not said otherwise {ROBOTS} robots "
        f"of {BAGS} bags, {len(NAMES)} parameters. Planted: {PLANTED} robots off by {EFFECT:g} "
        f"robot-to-robot deviations in one parameter or residual; {DRIFTING} drifting by "
        f"{CHANGE:g} at once, or by {2 * CHANGE:g} as a ramp.",
        "",
        "| | " + " | ".join(name for name, _ in cases) + " |",
        "|---|" + "---|" * len(cases),
    ]

    def row(words: str, value: object) -> None:
        cells = [value(counts) for _, counts in cases]  # type: ignore[operator]
        said.append(f"| {words} | " + " | ".join(cells) + " |")

    def share(part: int, whole: int) -> str:
        return f"{100.0 * part / whole:.1f} %" if whole else "–"

    row("95 % interval of the mean covers", lambda c: share(c.mean, c.quantities))
    row("95 % interval of σ between robots covers", lambda c: share(c.sigma, c.quantities))
    row("prediction interval holds the next robot", lambda c: share(c.ahead, c.quantities))
    row(
        "95 % interval of a robot's parameter covers",
        lambda c: share(c.robot_interval, c.robot_intervals),
    )
    row(
        "false share of robots that differ, mean",
        lambda c: f"{100 * np.mean(c.false_shares):.1f} %",
    )
    row("planted robots found", lambda c: share(c.detected, c.planted))
    row(
        "false share of robots that changed, mean",
        lambda c: f"{100 * np.mean(c.false_change_shares):.1f} %",
    )
    row("drifting robots found", lambda c: share(c.changed, c.drifting))
    row("date within two bags", lambda c: share(c.dates, c.drifting))
    row("interval of the date covers", lambda c: share(c.dates_in_interval, c.drifting))
    return said


def smallest_changes(draws: int = 100) -> list[str]:
    """Lines: how often a step in the middle of a robot's bags is found, by its size.

    At the p-value that one changed robot of fifty needs with fifteen quantities.
    """
    level = 0.1 / 50.0 / 15.0
    sizes = (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0)
    said = [
        "How often a step in the middle of a robot's bags is found where it is the only one of "
        "fifty robots that changed, by its size in deviations of a bag. Known from others: degrees "
        "of freedom.",
        "",
        "| bags | known from others | " + " | ".join(f"{size:g}" for size in sizes) + " |",
        "|---|---|" + "---|" * len(sizes),
    ]
    for bags, prior in (
        (6, 0.0),
        (6, 16.0),
        (8, 0.0),
        (8, 16.0),
        (12, 16.0),
        (20, 0.0),
        (20, 48.0),
    ):
        random = np.random.default_rng(bags)
        shares = []
        for size in sizes:
            count = 0
            for _ in range(draws):
                values = random.standard_normal(bags)
                values[bags // 2 :] += size
                change = change_of(values, np.ones(bags), np.arange(bags) * 1.0, prior)
                count += change is not None and change.p_value <= level
            shares.append(f"{100.0 * count / draws:.0f} %")
        said.append(f"| {bags} | {prior:g} | " + " | ".join(shares) + " |")
    return said
