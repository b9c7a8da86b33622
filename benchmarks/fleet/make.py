"""Bags of the simulated fleet, its manifest, its configuration, and the truth beside them."""

import csv
import json
import time
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np

from benchmarks.fleet.arms import DRIFTING, PLANTED, TYPE, Drifting, Planted, drawn, in_bag
from idim_iv_ros.configuration import Configuration, load_configuration
from idim_iv_ros.excitation.excite import random_motion
from idim_iv_ros.excitation.trajectory import Trajectory
from idim_iv_ros.recording.writing.write import write_bag
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulators.recording import recorded_topics, simulated_robot

CONFIG = Path(__file__).parents[2] / "config"
RATE = 500.0  # Hz
START = datetime(2026, 1, 5, 8, 0, tzinfo=timezone.utc)
CORRUPT = 0.01  # of the bags, at least one
_HEAD = 700  # bytes of a bag that was cut off


@dataclass(frozen=True)
class Arm:
    """One robot of the fleet."""

    name: str
    parameters: dict[str, float]
    planted: Planted | None
    drifting: Drifting | None


def fleet_of(robots: int, seed: int) -> list[Arm]:
    """Draw the arms; the five planted and three drifting ones are scattered among them."""
    random = np.random.default_rng([seed, 0])
    special = random.permutation(robots)
    planted = {int(k): change for k, change in zip(special, PLANTED, strict=False)}
    drifting = {
        int(k): change for k, change in zip(special[len(PLANTED) :], DRIFTING, strict=False)
    }
    return [
        Arm(f"arm-{k + 1:02d}", drawn(random), planted.get(k), drifting.get(k))
        for k in range(robots)
    ]


def configured(out: Path) -> Configuration:
    """Write the configuration of the type, and read it."""
    for suffix in (".yaml", ".urdf"):
        text = (CONFIG / f"arm2{suffix}").read_text(encoding="utf-8")
        # 500 Hz: the law's period is that of the recording.
        (out / f"arm2{suffix}").write_text(text.replace("period: 0.001", "period: 0.002"), "utf-8")
    return load_configuration(out / "arm2.yaml")


def make(out: Path, *, robots: int, bags: int, seconds: float, seed: int = 1) -> None:
    """Write the fleet: ``bags/``, ``manifest.csv``, ``arm2.yaml``, ``truth.json``."""
    (out / "bags").mkdir(parents=True, exist_ok=True)
    configuration = configured(out)
    motions = [
        random_motion(configuration, duration=seconds, rate=RATE, seed=100 + k) for k in range(bags)
    ]
    fleet = fleet_of(robots, seed)
    random = np.random.default_rng([seed, 1])
    corrupt = random.choice(robots * bags, max(1, round(CORRUPT * robots * bags)), replace=False)
    rows, broken, started = [], [], time.perf_counter()
    for number, arm in enumerate(fleet):
        for bag in range(bags):
            name = f"bags/{arm.name}-{bag + 1:02d}.mcap"
            when = START + timedelta(days=7 * bag, minutes=10 * number)
            write_one(out / name, configuration, arm, motions[bag], bag, bags, [seed, number, bag])
            if number * bags + bag in corrupt:
                damage(out / name, len(broken))
                broken.append(name)
            stamp = when.strftime("%Y-%m-%dT%H:%M:%SZ")
            rows.append([name, arm.name, "arm2", stamp])
        print(f"{arm.name} {time.perf_counter() - started:.0f} s", flush=True)
    with (out / "manifest.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([["uri", "robot", "type", "time"], *rows])
    truth = {
        "type": TYPE,
        "robots": [asdict(arm) for arm in fleet],
        "bags": bags,
        "corrupt": broken,
    }
    (out / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def write_one(
    path: Path,
    configuration: Configuration,
    arm: Arm,
    motion: Trajectory,
    bag: int,
    bags: int,
    seed: list[int],
) -> None:
    """Simulate one bag and write it."""
    random = np.random.default_rng(seed)
    changes = dict(arm.planted.change) if arm.planted else {}
    if arm.drifting:
        changes[arm.drifting.parameter] = arm.drifting.at(bag, bags)
    parameters = in_bag(arm.parameters, random, changes)
    whole = configuration.changed("simulated_robot", parameters=parameters)
    beyond = arm.planted.effects if arm.planted else ()
    robot = replace(
        simulated_robot(whole),
        effects=tuple(SimulatedEffect(name, joint, dict(v)) for name, joint, v in beyond),
    )
    record = robot.record(motion, int(random.integers(2**31)))
    write_bag(path, recorded_topics(robot, record), robot_description=robot.description, force=True)


def damage(path: Path, number: int) -> None:
    """Make a bag unreadable: cut off behind its head, empty, or overwritten in the middle."""
    content = bytearray(path.read_bytes())
    if number % 3 == 0:
        content = content[:_HEAD]
    elif number % 3 == 1:
        content = bytearray()
    else:
        noise = np.random.default_rng(number).bytes(len(content) - 200)
        content[100:-100] = noise
    path.write_bytes(bytes(content))
