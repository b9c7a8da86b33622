"""Servos without torques: a real one with known masses, real gains, and simulated ones in MuJoCo.

    python -m benchmarks.servos [--seeds 50] [--data ../shared/data]

The STS3215's masses are found from runs that were not used for the servo, and its motion is
simulated from commands alone beside the peer's published parameters; of the XL330 one of several
gains is said wrongly; MuJoCo's position servos show whether the intervals hold. The recordings are
not in the project: README says where they are published.
"""

import argparse
import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from benchmarks.measurement import write_page
from idim_iv_ros.model.robot import load_robot
from idim_iv_ros.servo.fit import (
    Drive,
    DriveEstimate,
    Motion,
    Run,
    fit_factor,
    fit_joint,
    fit_servos,
    ordinary_least_squares,
)
from idim_iv_ros.servo.identify import absolute_numbers, interval_width, ratio_numbers
from idim_iv_ros.servo.loop_kernel import Load

FloatArray = NDArray[np.float64]
GRAVITY = 9.81
ARM_MASS = {0.10: 0.036, 0.15: 0.050}  # kg by length, from the configurations of the data set
GAINS = (4, 8, 12, 16, 24, 32)
# Published fit of the STS3215 (model M1): torque constant N m/A, resistance Ω, armature kg m²,
# dry friction N m, viscous friction N m s/rad; the duty is error_gain · gain · error, below one.
TORQUE_CONSTANT, RESISTANCE = 3.607, 9.817
ARMATURE, FRICTION, VISCOUS, ERROR_GAIN = 0.02777, 0.0528, 0.0590, 0.16489
STEP = 0.2e-3  # s, of MuJoCo
TRUTH = {"stiffness": 17.8, "armature": 0.028, "damping": 0.6, "dry friction": 0.06, "delay": 0.023}
LIMIT, MASS, LENGTH = 4.0, 0.5, 0.15
NAMES = (*TRUTH, "torque limit")


def pendulum(
    time_: FloatArray,
    position: FloatArray,
    command: FloatArray,
    mass: float,
    length: float,
    arm: float,
    gain: float,
    rate: float,
) -> Run:
    """Return a run of a pendulum with a point mass on an arm, hanging down at zero."""
    count = int((time_[-1] - time_[0]) * rate) + 1
    grid = time_[0] + np.arange(count) / rate
    inner = np.pad(position, 2, mode="edge")
    middle = np.median(np.lib.stride_tricks.sliding_window_view(inner, 5), axis=1)
    position = np.where(np.abs(position - middle) < 0.5, position, middle)  # single wraps
    command_at = command[np.clip(np.searchsorted(time_, grid + 1e-4) - 1, 0, len(time_) - 1)]
    there = np.interp(grid, time_, position)
    inertia = np.full(count, (mass + arm / 3.0) * length**2)
    lever = GRAVITY * length * (mass + 0.5 * arm)
    columns = (lever * np.sin(there), lever * np.cos(there), there)
    return Run(
        rate=rate,
        command=command_at[:, None],
        position=there[:, None],
        valid=np.ones((count, 1), dtype=bool),
        gain=gain,
        load=Load(inertia[:, None, None], *(column[:, None] for column in columns)),
    )


def sts3215(folder: Path) -> dict[str, Run]:
    """Return the runs in which the servo is on throughout, by name; gains in parts of 8."""
    runs = {}
    for file in sorted(folder.glob("*.npz")):
        if file.name.startswith("lift_and_drop"):
            continue
        data = np.load(file)
        length = round(float(data["length"]), 3)
        runs[file.stem] = pendulum(
            data["timestamp"], data["position"].astype(float), data["goal_position"].astype(float),
            float(data["mass"]), length, ARM_MASS[length], float(data["kp"]) / 8.0, 100.0,
        )  # fmt: skip
    return runs


def with_load(run: Run) -> Callable[[float], Run]:
    """Return the run whose load is multiplied by a factor."""

    def scaled(factor: float) -> Run:
        mass, torque, slope, position = run.load
        return replace(run, load=Load(factor * mass, factor * torque, factor * slope, position))

    return scaled


def with_gain(run: Run) -> Callable[[float], Run]:
    """Return the run whose gain is multiplied by a factor."""
    return lambda factor: replace(run, gain=factor * run.gain)


def masses(runs: dict[str, Run]) -> list[str]:
    """Masses of runs that were not used, as factors of the true ones."""
    lines = [
        "| gain | masses used | masses found | runs | factor of the true mass, mean | within 5 % | "
        "true mass inside 95 % |",
        "|---|---|---|---|---|---|---|",
    ]
    near = inside = count = 0
    for gain in GAINS:
        for used, other in (("0.535", "0.969"), ("0.969", "0.535")):
            chosen = {
                name: run for name, run in runs.items()
                if name.startswith("sin_sin") and f"_kp{gain}_" in name
            }  # fmt: skip
            answer = fit_joint([run for name, run in chosen.items() if used in name])
            tested = [run for name, run in chosen.items() if other in name]
            factors = np.array([fit_factor(with_load(run), answer) for run in tested])
            off, width = np.abs(factors[:, 0] - 1.0), interval_width(answer)
            close, covered = int((off < 0.05).sum()), int((off < width * factors[:, 1]).sum())
            near, inside, count = near + close, inside + covered, count + len(tested)
            lines.append(
                f"| {gain} | {used} | {other} | {len(tested)} | {factors[:, 0].mean():.3f} | "
                f"{close} | {covered} |"
            )
    lines += ["", f"Within 5 %: {near} of {count} runs; inside the interval: {inside} of {count}."]
    return lines


def position_errors(runs: dict[str, Run]) -> list[str]:
    """Mean absolute position error of simulated second repeats, beside the published model."""
    first = [run for name, run in runs.items() if name.endswith("_1")]
    second = {name: run for name, run in runs.items() if name.endswith("_2")}
    start = time.process_time()
    answer = fit_joint(first)
    seconds = time.process_time() - start

    def errors(drive: Drive, motion: str = "") -> float:
        chosen = [run for name, run in second.items() if name.startswith(motion)]
        left = [np.abs((run.position - run.simulated(drive))[run.used]).mean() for run in chosen]
        return float(np.mean(left))

    rows = {f"this program, all gains at once ({seconds:.1f} s of processor)": answer.drive}
    for volts in (12.1, 15.0):
        stiffness = ERROR_GAIN * 8.0 * volts * TORQUE_CONSTANT / RESISTANCE
        damping = TORQUE_CONSTANT**2 / RESISTANCE + VISCOUS
        rows[f"published M1 at {volts:g} V"] = Drive(
            1.0 / stiffness, ARMATURE / stiffness, damping / stiffness, FRICTION / stiffness, 0.0,
            0.0, volts * TORQUE_CONSTANT / RESISTANCE / stiffness, 0.0,
        )  # fmt: skip
    kinds = ("", "sin_sin", "sin_time", "up_and", "brutal")
    lines = [
        f"{len(first)} first runs were fitted, {len(second)} second ones are simulated.",
        "",
        "| mean absolute error, rad | all | two sines | fast sine | up and down | step |",
        "|---|---|---|---|---|---|",
    ]
    for name, drive in rows.items():
        lines.append(
            f"| {name} | " + " | ".join(f"{errors(drive, kind):.4f}" for kind in kinds) + " |"
        )
    return lines


def wrong_gains(folder: Path) -> list[str]:
    """Recordings of the XL330 of which one gain is said wrongly."""
    runs: dict[int, Run] = {}
    for file in sorted(folder.glob("2*.json")):
        data = json.loads(file.read_text())
        if data["trajectory"] != "sin_sin":
            continue
        values = {
            key: np.array([entry[key] for entry in data["entries"]], dtype=float)
            for key in ("timestamp", "position", "goal_position")
        }
        runs[int(data["kp"])] = pendulum(
            values["timestamp"], values["position"], values["goal_position"], float(data["mass"]),
            float(data["length"]), 0.0, float(data["kp"]), 190.0,
        )  # fmt: skip
    lines = [
        "| gain that ran | gain that was said | estimated | 95 % interval | named |",
        "|---|---|---|---|---|",
    ]
    cases = [(100, 100), (200, 200), (400, 400), (100, 200), (200, 400), (400, 100), (200, 100)]
    for ran, said in cases:
        others = [replace(run, gain=kp / 100.0) for kp, run in runs.items() if kp != ran]
        answer = fit_joint(others)
        factor, std = fit_factor(with_gain(replace(runs[ran], gain=said / 100.0)), answer)
        wide = interval_width(answer) * std
        agrees = abs(factor - 1.0) < max(wide, 0.1)
        lines.append(
            f"| {ran} | {said} | {said * factor:.0f} | {said * (factor - wide):.0f} to "
            f"{said * (factor + wide):.0f} | {'no' if agrees else 'yes'} |"
        )
    return lines


def mujoco_servo(rate: float, seconds: float, seed: int, gravity: float = GRAVITY) -> Motion:
    """Return the recording of a position servo with a 12 bit encoder and held commands."""
    model = f"""<mujoco><option timestep="{STEP}" integrator="RK4" gravity="0 0 {-gravity}"/>
    <worldbody><body>
    <inertial mass="{MASS}" pos="{LENGTH} 0 0" diaginertia="2e-5 2e-5 2e-5"/>
    <joint name="j" axis="0 1 0" armature="{TRUTH["armature"]}" damping="{TRUTH["damping"]}"
    frictionloss="{TRUTH["dry friction"]}" solreffriction="0.002 1"
    solimpfriction="0.999 0.9999 0.0001"/></body></worldbody><actuator>
    <position joint="j" kp="{TRUTH["stiffness"]}" forcerange="-{LIMIT} {LIMIT}"/></actuator>
    </mujoco>"""
    compiled = mujoco.MjModel.from_xml_string(model)
    data = mujoco.MjData(compiled)
    random = np.random.default_rng(seed)
    count = int(seconds * rate)
    grid = np.arange(count) / rate
    command = np.zeros(count)
    waves = zip(random.uniform(0.1, 1.0, 5), random.uniform(0, 6.28, 5), strict=True)
    for frequency, phase in waves:
        command += 0.35 * np.sin(2.0 * np.pi * frequency * grid + phase) / (1.0 + frequency)
    command += np.repeat(random.uniform(-0.5, 0.5, int(seconds) + 1), int(rate) + 1)[:count]
    data.qpos[0] = command[0]
    position = np.empty(count)
    steps = round(1.0 / (rate * STEP))
    for k in range(count):
        position[k] = data.qpos[0]
        for i in range(steps):
            late = (k / rate + i * STEP - TRUTH["delay"]) * rate
            data.ctrl[0] = command[min(max(int(np.floor(late + 1e-9)), 0), count - 1)]
            mujoco.mj_step(compiled, data)
    step = 2.0 * np.pi / 4096
    position = np.round(position / step) * step
    valid = np.ones((count, 1), dtype=bool)
    return Motion(
        rate=rate,
        command=command[:, None],
        position=position[:, None],
        valid=valid,
        name=f"seed {seed}",
    )


URDF = f"""<robot name="servo"><link name="base"/><link name="arm"><inertial>
<origin xyz="{LENGTH} 0 0"/><mass value="{MASS}"/>
<inertia ixx="2e-5" iyy="2e-5" izz="2e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="10" velocity="10"/></joint></robot>"""


def coverage(rates: Iterable[float], seeds: int, seconds: float = 40.0) -> list[str]:
    """How often 95 % intervals hold the truth, and what least squares says of the same."""
    truth = TRUTH | {"torque limit": LIMIT}
    robot = load_robot(URDF, ["j"])
    lines = [
        f"{seeds} recordings of {seconds:g} s for each rate, 12 bit encoder; truths inside their "
        "95 % intervals, in %. Below: the median estimate in parts of the truth, of this program "
        "(with instruments) and of least squares on filtered measured motion (without), which is "
        "given the true delay.",
        "",
        "| rate, Hz | " + " | ".join(NAMES) + " |",
        "|---" * (len(NAMES) + 1) + "|",
    ]
    medians = []
    for rate in rates:
        inside = dict.fromkeys(NAMES, 0)
        with_, without = [], []
        for seed in range(seeds):
            ((runs, answer),) = fit_servos([mujoco_servo(rate, seconds, seed)], robot)
            numbers = {number.name: number for number in _numbers(answer)}
            for name in NAMES:
                inside[name] += numbers[name].low <= truth[name] <= numbers[name].high
            with_.append([numbers[name].value / truth[name] for name in NAMES])
            plain = ordinary_least_squares(_unlimited(runs), delay=TRUTH["delay"])
            scale = max(plain.compliance, 1e-9)
            values = (1.0, plain.inertia, plain.damping, plain.friction)
            without.append(
                [value / scale / truth[name] for name, value in zip(NAMES, values, strict=False)]
            )
        cells = [f"{100 * inside[name] / seeds:.0f}" for name in NAMES]
        lines.append(f"| {rate:g} | " + " | ".join(cells) + " |")
        for name, table in (("with", with_), ("without", without)):
            row = [f"{value:.3g}" for value in np.median(table, axis=0)]
            row += ["–"] * (len(NAMES) - len(row))
            medians.append(f"| {rate:g} Hz, {name} instruments | " + " | ".join(row) + " |")
    return [*lines, *medians]


def _unlimited(runs: Sequence[Run]) -> list[Run]:
    """Leave out what is beyond the torque limit: least squares knows of none."""
    most = LIMIT / TRUTH["stiffness"]
    return [
        replace(run, valid=run.valid & (np.abs(run.command - run.position) < 0.9 * most))
        for run in runs
    ]


def _numbers(answer: DriveEstimate) -> list[object]:
    return [*absolute_numbers(answer, 0.0), *ratio_numbers(answer, with_links=False)]


def main() -> None:
    """Measure and write benchmarks/results/servos.md."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    options = parser.parse_args()
    runs = sts3215(options.data / "feetech_sts3215")
    lines = ["## STS3215: masses of runs that were not used", ""]
    lines += [*masses(runs), "", "## STS3215: motion from commands alone", ""]
    lines += [*position_errors(runs), "", "## XL330: a gain that is said wrongly", ""]
    lines += [*wrong_gains(options.data / "bam_xl330"), "", "## MuJoCo's servos: coverage", ""]
    lines += coverage((25.0, 100.0, 500.0), options.seeds)
    write_page("servos", "Servos without torques", lines)


if __name__ == "__main__":
    main()
