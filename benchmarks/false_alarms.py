"""How often the diagnosis calls something a cause where nothing is wrong, and what it claims.

    python -m benchmarks.false_alarms [--quick 250] [--searched 25] [--full 60]

Quick nulls: the rows of a short recording of a simulated two-joint arm, with a torque that is
written here: the model's own plus noise (autoregressive of random order, with heavy tails, or
larger at speed). The noise models are fitted to each, as in a diagnosis. The p-value of the best of
all candidates is compared with how often it occurs; the search itself runs on a part of them.

Full nulls: recordings of the same arm, whose numbers differ from the nominal ones and which lacks
nothing, through the whole of `diagnose`.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.stats import beta

from bags.simulated_arms import arm2, joint_topics, record
from benchmarks.measurement import write_page
from idim_iv_ros import diagnose
from idim_iv_ros.compilation import one_thread
from idim_iv_ros.diagnosis.held_out.held_out import folds_of
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, smooth_regression
from idim_iv_ros.diagnosis.structural.attribution import Attribution, attributed
from idim_iv_ros.diagnosis.structural.calibration import (
    largest_support,
    null_noise,
    null_supports,
    p_value,
)
from idim_iv_ros.diagnosis.structural.candidate import operating_range
from idim_iv_ros.diagnosis.structural.confirmation import confirmation
from idim_iv_ros.diagnosis.structural.fold_model import FoldModel
from idim_iv_ros.diagnosis.structural.fold_products import FoldProducts
from idim_iv_ros.diagnosis.structural.likelihood import Regression
from idim_iv_ros.diagnosis.structural.menu import Menu, menu_of
from idim_iv_ros.diagnosis.structural.search import Grids
from idim_iv_ros.identification.prepare import read_configured
from idim_iv_ros.recording import write_bag
from idim_iv_ros.types import FloatArray

SECONDS = 16.0
SIZES = (0.15, 0.05)  # N m, of a row's noise
LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
WARM_UP = 200  # rows before the noise counts
Noise = Callable[[np.random.Generator, FloatArray], FloatArray]


def autoregressive(random: np.random.Generator, speed: FloatArray) -> FloatArray:
    """Gaussian noise of order 0 to 4 with poles up to 0.9."""
    return _shaped(random, random.standard_normal(len(speed) + WARM_UP))


def heavy_tails(random: np.random.Generator, speed: FloatArray) -> FloatArray:
    """The same with innovations of Student's t with five degrees of freedom."""
    return _shaped(random, random.standard_t(5, len(speed) + WARM_UP))


def larger_at_speed(random: np.random.Generator, speed: FloatArray) -> FloatArray:
    """The same, four times as large at full speed as at rest."""
    size = 0.25 + 0.75 * np.abs(speed) / np.abs(speed).max()
    return size * autoregressive(random, speed)


def _shaped(random: np.random.Generator, innovations: FloatArray) -> FloatArray:
    poles: list[complex] = []
    for _ in range(random.integers(0, 3)):
        radius, angle = random.uniform(0.2, 0.9), random.uniform(0.0, np.pi)
        poles += [radius * np.exp(1j * angle), radius * np.exp(-1j * angle)]
    noise = lfilter([1.0], np.real(np.poly(poles)), innovations)[WARM_UP:]
    return np.asarray(noise / noise.std())


WORLDS: dict[str, Noise] = {
    "autoregressive, Gaussian": autoregressive,
    "autoregressive, heavy tails (t₅)": heavy_tails,
    "autoregressive, four times larger at full speed": larger_at_speed,
}


def null_world(data: Baseline, plain: Regression, noise: Noise, seed: int) -> Regression:
    """Rows with the torque of the refit and noise."""
    random = np.random.default_rng(seed)
    made = []
    for joint, rows in enumerate(plain.joints):
        speed = np.concatenate(
            [m.rows(m.velocity[:, [joint]])[m.kept[:, joint], 0] for m in data.motions]
        )
        torque = rows.matrix @ data.estimate.linear.values[rows.columns]
        made.append(replace(rows, torque=torque + SIZES[joint] * noise(random, speed)))
    return Regression(tuple(made), plain.parameters)


def best_p_value(data: Baseline, world: Regression, menu: Menu, seed: int) -> float:
    """Of the best of all candidates beside the refit, its noise models fitted to this world."""
    fit = world.fit()
    folds, _ = folds_of(data, ())
    noise = null_noise(world, fit.noise_models, folds, seed)
    model = FoldModel(FoldProducts(world, fit.noise_models, fit.values, folds, menu, noise))
    return p_value(largest_support(model), null_supports(model))


def quick(count: int, searched: int) -> Iterator[str]:
    """Lines of the first part: claimed and true rates."""
    arm = arm2(seconds=SECONDS)
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "null.mcap"
        write_bag(bag, joint_topics(arm, record(arm, 1)))
        data = baseline(read_configured([bag], arm.configuration, None), arm.configuration)
    plain = smooth_regression(data)
    grids: Grids = {}
    first = attributed(data, null_world(data, plain, autoregressive, 1), (), grids=grids)
    menu = menu_of(first.catalogue, operating_range(data), grids)
    yield f"{len(data.rows[0])} rows a joint, {menu.total} columns of {len(menu.entries)} grids."
    yield ""
    yield "| noise | recordings | " + " | ".join(f"p ≤ {level:g}" for level in LEVELS) + " |"
    yield "|---|---|" + "---|" * len(LEVELS)
    for number, (name, noise) in enumerate(WORLDS.items()):
        found = np.array(
            [
                best_p_value(data, null_world(data, plain, noise, 1000 * number + k), menu, k)
                for k in range(count)
            ]
        )
        rates = " | ".join(_rate(int(np.sum(found <= level)), count) for level in LEVELS)
        yield f"| {name} | {count} | {rates} |"
    yield ""
    yield "| noise | recordings searched | accepted by the search | cause after cross-fitting |"
    yield "|---|---|---|---|"
    for number, (name, noise) in enumerate(WORLDS.items()):
        accepted = named = 0
        for k in range(searched):
            world = null_world(data, plain, noise, 1000 * number + k)
            attribution: Attribution = attributed(data, world, (), grids=grids)
            accepted += bool(attribution.found)
            named += bool(attribution.found) and bool(confirmation(data, attribution).model.found)
        yield f"| {name} | {searched} | {_rate(accepted, searched)} | {_rate(named, searched)} |"


def full(count: int) -> Iterator[str]:
    """Lines of the second part: what whole diagnoses say of an arm that lacks nothing."""
    structural = hints = extra = 0
    named: list[str] = []
    for seed in range(count):
        arm = arm2(seconds=SECONDS, seed=seed + 1)
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder) / "null.mcap"
            write_bag(bag, joint_topics(arm, record(arm, seed)))
            result = diagnose([bag], arm.configuration)
        causes = [each for each in result.causes if each.kind == "structural"]
        structural += bool(causes)
        hints += bool(result.hints)
        extra += result.unexplained is not None
        named += [f"{each.effect} at {each.joint}" for each in causes]
    yield "| whole diagnoses | with a structural cause | with a hint | with something unexplained |"
    yield "|---|---|---|---|"
    rates = " | ".join(_rate(each, count) for each in (structural, hints, extra))
    yield f"| {count} | {rates} |"
    if named:
        yield ""
        yield f"Named: {', '.join(named)}."


def shown(lines: Iterator[str]) -> Iterator[str]:
    """Lines, printed when they are made: the whole takes minutes."""
    for line in lines:
        print(line, file=sys.stderr, flush=True)
        yield line


def _rate(hits: int, count: int) -> str:
    """Share with its exact 95 % interval (Clopper and Pearson), in percent."""
    if not count:
        return "–"
    low = 0.0 if hits == 0 else float(beta.ppf(0.025, hits, count - hits + 1))
    high = 1.0 if hits == count else float(beta.ppf(0.975, hits + 1, count - hits))
    return f"{100 * hits / count:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def main() -> None:
    """Run both parts and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", type=int, default=250, help="null recordings of each noise")
    parser.add_argument("--searched", type=int, default=25, help="of them, searched")
    parser.add_argument("--full", type=int, default=60, help="whole diagnoses")
    arguments = parser.parse_args()
    start = time.process_time()
    with one_thread():
        lines = [
            f"- arguments: `--quick {arguments.quick} --searched {arguments.searched} "
            f"--full {arguments.full}`",
            "",
            "Nothing is wrong in any of these recordings. Each rate has its exact 95 % interval; a",
            "p-value is calibrated where the rate of values below a level is that level.",
            "",
            "## The p-value of the best of all candidates",
            "",
            "A short recording of a simulated arm with two joints, its torque replaced by that of",
            "the refit and noise; the noise models are fitted to each as in a diagnosis.",
            "",
            *shown(quick(arguments.quick, arguments.searched)),
            "",
            "## Whole diagnoses",
            "",
            f"Recordings of {SECONDS:g} s of the same arm, another motion each, whose numbers are",
            "10 to 30 % off the nominal ones and which lacks no effect.",
            "",
            *shown(full(arguments.full)),
            "",
        ]
    lines.append(f"CPU time: {(time.process_time() - start) / 60.0:.1f} minutes.")
    write_page("false_alarms", "False alarms where nothing is wrong", lines)


if __name__ == "__main__":
    main()
