"""Closed loop of the TX40, 10 s at 5 kHz with four plant steps a period, against MuJoCo.

MuJoCo's rollout takes the same number of steps in C, open loop, with the torques that our
control commanded. It runs with its dry friction (a soft constraint) and without.
"""

import os
import sys
import tempfile
import time

from benchmarks.measurement import measure, report_case, write_page

RATE, SECONDS, OVERSAMPLING = 5000.0, 10.0, 4
STEPS = int(RATE * SECONDS) * OVERSAMPLING


def simulate():
    from pathlib import Path

    from idim_iv_ros import load_configuration
    from idim_iv_ros.excitation.excite import random_motion
    from idim_iv_ros.simulation import simulate_closed_loop
    from idim_iv_ros.simulators.recording import simulated_robot

    configuration = load_configuration(Path(__file__).parent.parent / "config" / "tx40.yaml")
    urdf = configuration.robot.urdf
    tx40 = simulated_robot(configuration)
    motion = random_motion(configuration, duration=SECONDS, rate=RATE, seed=1)

    def run():
        return simulate_closed_loop(
            tx40.robot,
            tx40.robot.given,
            tx40.law,
            rate=RATE,
            position_reference=motion.position,
            velocity_reference=motion.velocity,
            initial_position=motion.position[0],
            initial_velocity=motion.velocity[0],
            plant_step=1.0 / RATE / OVERSAMPLING,
        )

    return tx40.robot, urdf, motion, run


def ours() -> None:
    started = time.perf_counter()
    *_, run = simulate()
    run()
    first = time.perf_counter() - started
    started = time.perf_counter()
    result = run()
    seconds = time.perf_counter() - started
    if result.diverged:
        raise SystemExit(result.diverged)
    report_case(seconds, first=first)


def mujoco_rollout() -> None:
    import mujoco
    import numpy as np
    from mujoco import rollout

    robot, urdf, motion, run = simulate()
    torque = np.repeat(run().torque, OVERSAMPLING, axis=0)
    state_spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    seconds = {}
    for friction in (True, False):
        model = mujoco.MjModel.from_xml_path(str(urdf))
        model.opt.timestep = 1.0 / RATE / OVERSAMPLING
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        model.dof_armature[:] = robot.given.drive_inertia
        model.dof_damping[:] = robot.given.viscous
        model.dof_frictionloss[:] = robot.given.coulomb if friction else 0.0
        data = mujoco.MjData(model)
        data.qpos[:] = motion.position[0]
        start = np.empty(mujoco.mj_stateSize(model, state_spec))
        mujoco.mj_getState(model, data, start, state_spec)
        started = time.perf_counter()
        rollout.rollout(
            model,
            data,
            start[None],
            torque[None],
            control_spec=mujoco.mjtState.mjSTATE_QFRC_APPLIED,
        )
        seconds[friction] = time.perf_counter() - started
    report_case(seconds[True], frictionless=seconds[False])


def main() -> None:
    try:
        import mujoco
    except ImportError:
        raise SystemExit("mujoco is not installed: pip install 'idim-iv-ros[bench]'") from None
    with tempfile.TemporaryDirectory() as empty:
        os.environ["NUMBA_CACHE_DIR"] = empty
        compiled = measure("benchmarks.simulation", "ours", 1)
        mine = measure("benchmarks.simulation", "ours", 3)
        theirs = measure("benchmarks.simulation", "mujoco", 3)
    write_page(
        "simulation",
        f"Simulating the TX40 with friction, {SECONDS:g} s at {RATE / 1e3:g} kHz, {STEPS:,} steps",
        [
            f"MuJoCo {mujoco.__version__}, its rollout function in C (Euler, implicit damping).",
            "",
            "| | seconds | µs a step |",
            "|---|---|---|",
            *(
                f"| {name} | {seconds:.3f} | {1e6 * seconds / STEPS:.2f} |"
                for name, seconds in (
                    ("simulate_closed_loop, control and sticking friction", mine.seconds),
                    ("MuJoCo, open loop, dry friction", theirs.seconds),
                    ("MuJoCo, open loop, no dry friction", theirs.detail["frictionless"]),
                )
            ),
            "",
            f"Ratio: {mine.seconds / theirs.seconds:.2f} times MuJoCo's time with dry friction, "
            f"{mine.seconds / theirs.detail['frictionless']:.2f} without (target: at most 3).",
            "",
            f"First call with everything imported: {compiled.detail['first']:.1f} s with an empty "
            f"numba cache (target: 15), {mine.detail['first']:.1f} s afterwards (target: 2), one "
            "simulation included.",
        ],
    )


if __name__ == "__main__":
    cases = {"ours": ours, "mujoco": mujoco_rollout}
    cases.get(sys.argv[1] if len(sys.argv) > 1 else "", main)()
