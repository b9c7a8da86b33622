"""MuJoCo's recursive Newton-Euler, called from compiled code through its C library."""

from pathlib import Path

import llvmlite.binding
import mujoco
import numpy as np
from numba import njit, types

# Compiled code finds the functions by name among the libraries of the process.
_LIBRARY = next(Path(mujoco.__file__).parent.glob("libmujoco*"))
llvmlite.binding.load_library_permanently(str(_LIBRARY))

_on_model = types.void(types.intp, types.intp)
_kinematics = types.ExternalFunction("mj_kinematics", _on_model)
_centre_positions = types.ExternalFunction("mj_comPos", _on_model)
_centre_velocities = types.ExternalFunction("mj_comVel", _on_model)
_newton_euler = types.ExternalFunction(
    "mj_rne", types.void(types.intp, types.intp, types.int32, types.intp)
)


@njit(cache=True)
def mass_and_bias(
    model: int,
    data: int,
    state: tuple[np.ndarray, np.ndarray, np.ndarray],
    position: np.ndarray,
    velocity: np.ndarray,
    mass: np.ndarray,
    bias: np.ndarray,
) -> None:
    """Mass matrix (n, n) in kg m² and Coriolis plus gravity torque (n,) in N m, in place.

    Column i of the mass matrix is what one rad/s² of joint i asks for at rest, less gravity; this
    holds in every version of MuJoCo, whose storage of the matrix changed several times.

    Parameters
    ----------
    model, data
        Addresses of the mjModel and the mjData.
    state
        Views of the mjData: position, velocity, acceleration, each (n,).
    position, velocity : (n,) rad, rad/s
    """
    qpos, qvel, qacc = state
    n = len(position)
    qpos[:] = position
    _kinematics(model, data)
    _centre_positions(model, data)
    qvel[:] = 0.0
    qacc[:] = 0.0
    _centre_velocities(model, data)
    _newton_euler(model, data, 0, bias.ctypes.data)
    for i in range(n):
        qacc[i] = 1.0
        _newton_euler(model, data, 1, mass[i].ctypes.data)
        qacc[i] = 0.0
        for j in range(n):
            mass[i, j] -= bias[j]
    qvel[:] = velocity
    _centre_velocities(model, data)
    _newton_euler(model, data, 0, bias.ctypes.data)
