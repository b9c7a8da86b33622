"""Rows whose torque is written here: model + formula + noise, on the motion of a simulated arm.

Nothing of the simulator's effects is used.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.estimation.likelihood import Regression

NOISE = (0.15, 0.05)  # N m, of a row
Torque = Callable[[SmoothMotion], np.ndarray]


def world(
    data: Baseline,
    seed: int,
    joint: int = 0,
    torque: Torque | None = None,
    *,
    pole: float = 0.0,
    change: np.ndarray | None = None,
    torques: Sequence[np.ndarray] = (),
    gains: Sequence[float] = (),
    noise: Sequence[float] = NOISE,
) -> Regression:
    """Rows of the refit with the nominal torque, an effect at one joint and noise.

    Parameters
    ----------
    pole
        Of the noise; 0: white.
    change
        (b,) of the base parameters from the nominal ones to the true ones; None: they are right.
    torques
        Further torque (s,) of each joint on the first motion.
    gains
        Of what is recorded, by joint.
    noise
        Of the rows of each joint, N m.
    """
    random = np.random.default_rng(seed)
    plain = data.regression
    assert data.prepared.given is not None
    true = data.prepared.given + (0.0 if change is None else change)
    made = []
    for number, rows in enumerate(plain.joints):
        values = rows.matrix @ true[rows.columns]
        if torque is not None and number == joint:
            added = [m.rows(torque(m)[:, None])[m.kept[:, joint], 0] for m in data.motions]
            values = values + np.concatenate(added)
        if len(torques):
            motion = data.motions[0]
            values = values + motion.rows(torques[number][:, None])[motion.kept[:, number], 0]
        if len(gains):
            values = gains[number] * values
        errors = noise[number] * random.standard_normal(len(values) + 50)
        errors = np.sqrt(1.0 - pole**2) * lfilter([1.0], [1.0, -pole], errors)[50:]
        made.append(replace(rows, torque=values + errors))
    return Regression(tuple(made), plain.parameters)


# Effect, joint, pole of the noise, torque.
SINGLE: list[tuple[str, int, float, Torque]] = [
    ("stribeck", 1, 0.0, lambda m: 0.5 * m.slip[:, 1] * np.exp(-((m.velocity[:, 1] / 0.15) ** 2))),
    ("position_ripple", 0, 0.7,
     lambda m: 0.5 * np.sin(23.0 * m.position[:, 0]) + 0.2 * np.cos(23.0 * m.position[:, 0])),
    ("torque_saturation", 0, 0.0,
     lambda m: 0.4 * np.sign(m.torque[:, 0]) * np.maximum(abs(m.torque[:, 0]) - 12.0, 0.0)),
    ("load_dependent_friction", 0, 0.7, lambda m: 0.1 * abs(m.load[:, 0]) * m.slip[:, 0]),
    ("friction_drift", 1, 0.0, lambda m: 0.5 * np.exp(-m.time / 5.0) * m.slip[:, 1]),
    # Much: the first scan then takes a short delay with a coefficient that physics excludes.
    ("time_delay", 1, 0.0,
     lambda m: np.interp(m.time + 0.01, m.time, m.torque[:, 1]) - m.torque[:, 1]),
    ("asymmetric_friction", 0, 0.7, lambda m: 0.3 * abs(m.velocity[:, 0])),
]  # fmt: skip


def pulses(motion: SmoothMotion) -> np.ndarray:
    """Six contacts of 60 ms with nothing in common."""
    torque = np.zeros(len(motion.time))
    for start, size in zip(PULSES, (9.0, -7.0, 8.0, -9.0, 6.0, -8.0), strict=True):
        torque[(motion.time >= start) & (motion.time < start + 0.06)] = size
    return torque


PULSES = (2.3, 4.9, 7.1, 9.2, 11.8, 14.1)  # s


def point_mass(data: Baseline, mass: float, centre: Sequence[float]) -> list[np.ndarray]:
    """Torque (s,) of a point mass on the last link at every joint, by pinocchio's recursion."""
    robot = data.prepared.model.robot.pinocchio
    heavy = robot.copy()
    body = pin.Inertia(mass, np.array(centre), np.zeros((3, 3)))
    heavy.appendBodyToJoint(heavy.njoints - 1, body, pin.SE3.Identity())
    motion = data.motions[0]
    plain, loaded = robot.createData(), heavy.createData()
    torque = np.array(
        [
            pin.rnea(heavy, loaded, *state) - pin.rnea(robot, plain, *state)
            for state in zip(motion.position, motion.velocity, motion.acceleration, strict=True)
        ]
    )
    return list(torque.T)
