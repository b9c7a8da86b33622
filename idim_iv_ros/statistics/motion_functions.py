"""Functions of a motion that no rigid-body model of it need hold: what a residual is held against.

Families, as an engineer would name what is missing: *position* (gravity, springs, ripple),
*speed* (shape of the friction), *acceleration* (inertia, couplings between joints).
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from idim_iv_ros.types import FloatArray

POSITION, SPEED, ACCELERATION = FAMILIES = ("position", "speed", "acceleration")


def shared_functions(
    joint_types: Sequence[str], q: FloatArray, dq: FloatArray, ddq: FloatArray
) -> dict[str, FloatArray]:
    """Functions of the states (n_samples, n_joints), the same for every joint's torque.

    *position*: cos and sin of every joint (position and its square for a prismatic one), and
    their products for every pair of joints. *acceleration*: that of every joint, and all
    products of two speeds. (n_samples, m) each.
    """
    waves = [
        [np.cos(q[:, k]), np.sin(q[:, k])] if kind == "revolute" else [q[:, k], q[:, k] ** 2]
        for k, kind in enumerate(joint_types)
    ]
    position = [wave for waves_of_joint in waves for wave in waves_of_joint]
    for first, second in combinations(waves, 2):
        position += [a * b for a in first for b in second]
    joints = range(dq.shape[1])
    products = [dq[:, i] * dq[:, k] for i in joints for k in joints if i <= k]
    return {
        POSITION: np.column_stack(position),
        ACCELERATION: np.column_stack([ddq, *products]),
    }


def speed_functions(joint: int, dq: FloatArray, peak: float) -> FloatArray:
    """Shapes of friction over the speed of one joint, and the direction of every other.

    Powers for either direction, and what decays at 3, 10 and 30 % of the peak speed: Stribeck's
    shape at several widths. `peak` in rad/s (m/s).
    """
    own = dq[:, joint] / peak
    share = np.abs(own)
    functions = [np.sign(own), own, share, own * share, share**2, own * share**2]
    functions += [np.sign(own) * np.exp(-share / level) for level in (0.03, 0.1, 0.3)]
    functions += [np.sign(dq[:, k]) for k in range(dq.shape[1]) if k != joint]
    return np.column_stack(functions)
