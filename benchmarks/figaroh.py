"""Speed and memory against figaroh 1.0.2 on the same URDF and samples.

Two cases: least squares on 100,000 samples (regressor, base parameters, solution), and the whole
of IDIM-IV on a 9 s, 5 kHz recording against figaroh's least squares on the same samples.
"""

import sys
import tempfile
import time
import types
import warnings
from pathlib import Path

import numpy as np

from benchmarks.measurement import measure_pair, report_case, write_page

CONFIG = Path(__file__).parent.parent / "config"
SAMPLES = 100_000
IV_SAMPLES = 45_000
CHUNK = 2000
BAG = Path(tempfile.gettempdir()) / "idim_iv_arm6_5khz.mcap"
RATE = 5000.0


def motion(samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Six joints, five sines each, as in an exciting trajectory; analytic derivatives."""
    random = np.random.default_rng(7)
    clock = np.arange(samples)[:, None] / RATE
    q, dq, ddq = (np.zeros((samples, 6)) for _ in range(3))
    for _ in range(5):
        frequency = 2 * np.pi * random.uniform(0.1, 1.5, 6)
        amplitude, phase = random.uniform(0.1, 0.3, 6), random.uniform(0, 6, 6)
        angle = frequency * clock + phase
        q += amplitude * np.sin(angle)
        dq += amplitude * frequency * np.cos(angle)
        ddq -= amplitude * frequency**2 * np.sin(angle)
    return q, dq, ddq


def torque(samples: int) -> np.ndarray:
    """Any torque does for timing: both sides solve the same system."""
    return np.random.default_rng(8).normal(size=(samples, 6))


def peer(samples: int) -> None:
    import pinocchio as pin

    sys.modules.setdefault("matplotlib.pyplot", types.ModuleType("matplotlib.pyplot"))
    warnings.simplefilter("ignore")
    from figaroh.tools.qrdecomposition import double_QR
    from figaroh.tools.regressor import (
        build_regressor_basic,
        build_regressor_reduced,
        get_index_eliminate,
    )

    class Robot:
        model = pin.buildModelFromUrdf(str(CONFIG / "arm6.urdf"))
        data = model.createData()

    options = {
        "has_friction": True,
        "has_actuator_inertia": True,
        "has_joint_offset": True,
        "is_joint_torques": True,
        "is_external_wrench": False,
        "act_idxv": list(range(6)),
    }
    q, dq, ddq = motion(samples)
    tau = torque(samples).T.ravel()
    started = time.perf_counter()
    matrix = build_regressor_basic(Robot(), q, dq, ddq, options)
    names = {f"p{column}": 0.0 for column in range(matrix.shape[1])}
    eliminated, kept = get_index_eliminate(matrix, names, 1e-6)
    reduced = build_regressor_reduced(matrix, eliminated)
    outcome = double_QR(tau, reduced, kept)
    report_case(time.perf_counter() - started, base=len(outcome[1]))


def ours(samples: int) -> None:
    from idim_iv_ros.estimation.least_squares import solve_least_squares
    from idim_iv_ros.estimation.qr import streamed_r_factor
    from idim_iv_ros.estimation.rows import JointRows
    from idim_iv_ros.model import (
        InverseModel,
        StandardRegressor,
        find_base_parameters,
        load_robot,
        parameter_layout,
    )

    q, dq, ddq = motion(samples)
    tau = torque(samples)
    started = time.perf_counter()
    robot = load_robot((CONFIG / "arm6.urdf").read_text(), [f"joint_{k}" for k in range(1, 7)])
    friction = ["viscous", "coulomb", "offset"]
    layout = parameter_layout(robot.joint_types, friction=friction, drive_inertia=True)
    regressor = StandardRegressor(robot, layout)
    model = InverseModel(robot, regressor, find_base_parameters(regressor))
    columns = [np.flatnonzero(active) for active in model.base.active]
    factors = [np.zeros((0, len(active) + 1)) for active in columns]
    for start in range(0, samples, CHUNK):
        block = slice(start, start + CHUNK)
        matrices = model.joint_matrices(q[block], dq[block], ddq[block])
        for joint, matrix in enumerate(matrices):
            rows = np.column_stack([matrix, tau[block, joint]])
            factors[joint] = streamed_r_factor((factors[joint], rows), rows.shape[1])
    folded = [
        JointRows(factor[:, :-1], factor[:, -1], active, represented=samples)
        for active, factor in zip(columns, factors, strict=True)
    ]
    solve_least_squares(folded, len(model.base.columns), weighted=False)
    report_case(time.perf_counter() - started, base=len(model.base.columns))


def make_bag() -> None:
    """Nine seconds of arm6 at 5 kHz, controlled at the same rate."""
    from dataclasses import replace

    from bags import simulated_arms
    from idim_iv_ros.recording.writing.write import JointTopic, write_bag

    arm = simulated_arms.arm6(seconds=IV_SAMPLES / RATE, rate=RATE)
    arm = replace(arm, law=replace(arm.law, period=1.0 / RATE))
    record = simulated_arms.record(arm, 1)
    joints = arm.configuration.robot.joints
    topics = [
        JointTopic("/joint_states", joints, record.time, record.position, None, record.effort),
        JointTopic(
            "/joint_reference",
            joints,
            record.time,
            record.position_reference,
            record.velocity_reference,
        ),
    ]
    write_bag(BAG, topics)


def whole_identification() -> None:
    """Decode, filter, iterate with simulations, test: everything but writing the report."""
    from idim_iv_ros import identify, load_configuration

    started = time.perf_counter()
    configuration = load_configuration(CONFIG / "arm6.yaml")
    configuration = configuration.changed("controller", period=1.0 / RATE)
    configuration = configuration.changed(
        "processing", position_cutoff=50.0, decimation_cutoff=20.0
    )
    result = identify([BAG], configuration)
    report_case(
        time.perf_counter() - started,
        base=len(result.parameters),
        iterations=result.iterations,
        converged=float(result.converged),
    )


def main() -> None:
    mine, theirs, share = measure_pair("benchmarks.figaroh", "ours", "peer")
    if not BAG.exists():
        make_bag()
    whole, short, whole_share = measure_pair("benchmarks.figaroh", "identify", "peer-short", 5)
    lines = [
        f"Least squares, 6 joints, {SAMPLES:,} samples (regressor, base parameters, solution):",
        "",
        "| | seconds | peak memory | base parameters |",
        "|---|---|---|---|",
        f"| figaroh 1.0.2 | {theirs.seconds:.2f} | {theirs.peak / 1e6:.0f} MB | "
        f"{theirs.detail['base']:.0f} |",
        f"| idim_iv_ros | {mine.seconds:.2f} | {mine.peak / 1e6:.0f} MB | "
        f"{mine.detail['base']:.0f} |",
        "",
        f"Ratios: {1.0 / share:.1f} times faster (target: 8), "
        f"1/{theirs.peak / mine.peak:.1f} of the memory (target: 1/10).",
        "",
        f"The whole of IDIM-IV (decode, filter, {whole.detail['iterations']:.0f} iterations with "
        "simulation, tests; imports included, numba's cache warm) on 9 s at 5 kHz against "
        "figaroh's least squares on as many samples:",
        "",
        "| | seconds | peak memory |",
        "|---|---|---|",
        f"| figaroh 1.0.2, least squares | {short.seconds:.2f} | {short.peak / 1e6:.0f} MB |",
        f"| idim_iv_ros, IDIM-IV with its tests | {whole.seconds:.2f} | "
        f"{whole.peak / 1e6:.0f} MB |",
        "",
        f"Ratio: {whole_share:.2f} of figaroh's time (target: 0.8).",
    ]
    write_page("figaroh", "Against figaroh 1.0.2", lines)


if __name__ == "__main__":
    cases = {
        "ours": lambda: ours(SAMPLES),
        "peer": lambda: peer(SAMPLES),
        "peer-short": lambda: peer(IV_SAMPLES),
        "identify": whole_identification,
    }
    cases.get(sys.argv[1] if len(sys.argv) > 1 else "", main)()
