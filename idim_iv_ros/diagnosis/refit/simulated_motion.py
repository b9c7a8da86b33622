"""The simulated motion brought closer to the measured one, without its noise.

The simulated loop differs from the robot's by what nobody configured: periods of computing, the
filter of its speed, the drive. A percent that its motion lacks near the upper end of the band is a
percent of the inertial torque there, the same at all joints, and looks like a soft shaft or a slow
drive. The difference of the two motions is a linear function of the simulated one, as far as the
loops are linear: its coefficients are fitted where both are seen, and noise of the encoders, which
the simulated motion does not have, does not bias them.
"""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.signals import ParallelDecimation, zero_phase_butterworth
from idim_iv_ros.types import FloatArray

_JOINING_ORDER = 2  # of the filter that joins measured and simulated motion
_ROWS_PER_COEFFICIENT = 15  # with fewer, only the motion of the joint alone is fitted
_DERIVATIVES = 3  # of the simulated motion: as it is, and its first and second derivative

States = Sequence[FloatArray]


def above(signal: FloatArray, rate: float, cutoff: float) -> FloatArray:
    """Return what of a signal (s, n_joints) lies above the frequency where the motions join."""
    return signal - zero_phase_butterworth(
        signal,
        rate=rate,
        cutoff=settings.MEASURED_BELOW * cutoff,
        order=_JOINING_ORDER,
    )


def corrected_motions(
    measured: Sequence[States],
    simulated: Sequence[States],
    decimations: Sequence[ParallelDecimation],
    rates: Sequence[float],
    cutoff: float,
) -> list[list[FloatArray]]:
    """Simulated q, dq, ddq of each recording with what they miss of the measured ones.

    m̈_j − s̈_j = Σ_k Σ_d c_jkd dᵈs̈_k/dtᵈ, d = 0, 1, 2, by least squares over the rows of all
    recordings, of what lies above the frequency where the motions join. All joints k count where
    there are rows enough, else joint j alone.

    Parameters
    ----------
    measured, simulated
        q, dq, ddq (s, n_joints) of each recording.
    decimations
        To the rows.
    rates
        Samples per second.
    cutoff
        Of the decimation, Hz.
    """
    further = [_derivatives(states, rate) for states, rate in zip(simulated, rates, strict=True)]
    rows, targets = [], []
    for real, states, decimation, rate in zip(measured, further, decimations, rates, strict=True):
        columns = [decimation.whole(above(each, rate, cutoff)) for each in states[2:]]
        rows.append(np.stack(columns, axis=2))  # (m, n_joints, derivatives)
        targets.append(decimation.whole(above(real[2] - states[2], rate, cutoff)))
    coefficients = _coefficients(np.concatenate(rows), np.concatenate(targets))
    return [
        [
            states[order]
            + sum(states[order + d] @ coefficients[:, :, d].T for d in range(_DERIVATIVES))
            for order in range(3)
        ]
        for states in further
    ]


def _derivatives(states: States, rate: float) -> list[FloatArray]:
    """Position and its derivatives, up to the fourth."""
    made = list(states)
    for _ in range(_DERIVATIVES - 1):
        made.append(np.gradient(made[-1], 1.0 / rate, axis=0))
    return made


def _coefficients(rows: FloatArray, targets: FloatArray) -> FloatArray:
    """Coefficients (n_joints, n_joints, derivatives) of each joint's difference."""
    count, joints, derivatives = rows.shape
    every = count >= _ROWS_PER_COEFFICIENT * joints * derivatives
    made = np.zeros((joints, joints, derivatives))
    for joint in range(joints):
        used = np.arange(joints) if every else np.array([joint])
        table = rows[:, used].reshape(count, -1)
        scale = np.linalg.norm(table, axis=0)
        scale[scale == 0.0] = 1.0
        own = np.linalg.lstsq(table / scale, targets[:, joint], rcond=1e-6)[0] / scale
        made[joint, used] = own.reshape(len(used), derivatives)
    return made
