"""Compile what numba compiles, so that several processes find it in the cache.

    python -m tests.compile_kernels

Each process that finds the cache empty would compile for itself, about half a minute.
"""

from pathlib import Path

import numpy as np

from idim_iv_ros import load_configuration
from idim_iv_ros.simulation import (
    SimulatedEffect,
    inverse_dynamics,
    mass_matrix,
    simulate_closed_loop,
)
from idim_iv_ros.simulators.recording import simulated_robot

CONFIGURATION = Path(__file__).resolve().parent.parent / "config" / "arm2.yaml"


def main() -> None:
    configuration = load_configuration(CONFIGURATION)
    arm = simulated_robot(configuration)
    rest = np.zeros((2, len(configuration.robot.joints)))
    for effects in ((), (SimulatedEffect("torque_gain", None, {"factor": 1.1}),)):
        simulate_closed_loop(
            arm.robot,
            arm.robot.given,
            arm.law,
            rate=1000.0,
            position_reference=rest,
            initial_position=rest[0],
            initial_velocity=rest[0],
            effects=effects,
        )
    inverse_dynamics(arm.robot, arm.robot.given, rest, rest, rest)
    mass_matrix(arm.robot, arm.robot.given, rest)


if __name__ == "__main__":
    main()
