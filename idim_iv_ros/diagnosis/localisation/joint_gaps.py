"""How large the gap is at each joint."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor
from idim_iv_ros.diagnosis.result import JointGap
from idim_iv_ros.types import FloatArray


def joint_gaps(
    joints: Sequence[str],
    torques: Sequence[FloatArray],
    residuals: Sequence[FloatArray],
    floors: Sequence[NoiseFloor],
) -> tuple[JointGap, ...]:
    """RMS, relative size and share of each joint; energies are divided by those of the torque.

    Parameters
    ----------
    joints
        Names.
    torques, residuals
        (r_j,) N m (N) of each joint.
    floors
    """
    energy = [float(residual @ residual) for residual in residuals]
    whole = [float(torque @ torque) for torque in torques]
    relative = np.array([e / w if w > 0.0 else 0.0 for e, w in zip(energy, whole, strict=True)])
    total = float(relative.sum())
    return tuple(
        JointGap(
            joint=name,
            rms=float(np.sqrt(energy[j] / max(len(residuals[j]), 1))),
            relative_percent=100.0 * float(np.sqrt(relative[j])) if whole[j] > 0.0 else None,
            share=float(relative[j] / total) if total > 0.0 else 0.0,
            noise_floor=floors[j].sigma,
            floor_origin=floors[j].origin,
        )
        for j, name in enumerate(joints)
    )


def signed_share(before: float, after: float, size: float) -> float:
    """Root of before² − after² as a share of the torque; negative where the gap grows."""
    energy = float(before) ** 2 - float(after) ** 2
    return float(np.sign(energy) * np.sqrt(abs(energy))) / max(float(size), 1e-300)
