"""Speed and memory against figaroh 1.0.2 on the same URDF and samples.

Two cases: least squares on 100,000 samples (regressor, base parameters, solution), and the whole
of IDIM-IV on a 9 s, 5 kHz recording against figaroh's least squares on the same samples.
"""

import sys
import time
import types
import warnings
from pathlib import Path

import numpy as np

from benchmarks.measurement import report_case

CONFIG = Path(__file__).parent.parent / "config"
SAMPLES = 100_000
IV_SAMPLES = 45_000
RATE = 5000.0


def motion(samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Six joints, five sines each, as in an exciting trajectory; analytic derivatives."""
    random = np.random.default_rng(7)
    time_axis = np.arange(samples)[:, None, None] / RATE
    frequency = 2 * np.pi * random.uniform(0.1, 1.5, (1, 6, 5))
    amplitude, phase = random.uniform(0.1, 0.3, (1, 6, 5)), random.uniform(0, 6, (1, 6, 5))
    angle = frequency * time_axis + phase
    q = (amplitude * np.sin(angle)).sum(axis=2)
    dq = (amplitude * frequency * np.cos(angle)).sum(axis=2)
    return q, dq, -(amplitude * frequency**2 * np.sin(angle)).sum(axis=2)


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
    from idim_iv_ros.model import (
        StandardRegressor,
        find_base_parameters,
        load_robot,
        parameter_layout,
    )
    from idim_iv_ros.model.inverse_model import InverseModel

    q, dq, ddq = motion(samples)
    tau = torque(samples)
    started = time.perf_counter()
    robot = load_robot((CONFIG / "arm6.urdf").read_text(), [f"joint_{k}" for k in range(1, 7)])
    friction = ["viscous", "coulomb", "offset"]
    layout = parameter_layout(robot.joint_types, friction=friction, drive_inertia=True)
    regressor = StandardRegressor(robot, layout)
    model = InverseModel(robot, regressor, find_base_parameters(regressor))
    count = len(model.base.columns)
    triangles: list[np.ndarray | None] = [None] * 6
    for start in range(0, samples, 2000):
        block = slice(start, start + 2000)
        matrices = model.joint_matrices(q[block], dq[block], ddq[block])
        for joint, matrix in enumerate(matrices):
            rows = np.column_stack([matrix, tau[block, joint]])
            before = triangles[joint]
            stack = rows if before is None else np.vstack([before, rows])
            triangles[joint] = np.linalg.qr(stack, mode="r")
    spread = []
    for joint, triangle in enumerate(triangles):
        full = np.zeros((len(triangle), count + 1))
        full[:, np.append(np.flatnonzero(model.base.active[joint]), count)] = triangle
        spread.append(full)
    final = np.linalg.qr(np.vstack(spread), mode="r")
    np.linalg.solve(final[:count, :count], final[:count, -1])
    report_case(time.perf_counter() - started, base=count)
