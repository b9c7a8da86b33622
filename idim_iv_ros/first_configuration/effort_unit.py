"""Torque or current?  What a driver calls effort, compared with what the URDF needs."""

import re
from dataclasses import dataclass
from typing import Literal

import numpy as np

from idim_iv_ros.estimation.observation import observation_rows
from idim_iv_ros.identification.prepare import PreparedRegression
from idim_iv_ros.model import JointLimits
from idim_iv_ros.types import FloatArray

_FRICTION = ("Fv", "Fc", "off", "Fvm", "Fcm")
_LEAST_SHARE = 0.05  # of the torque's variance that only the masses explain
_LEAST_ROWS = 20
_LEAST_RATIO = 5.0  # standard deviations
_SAME = (0.5, 2.0)  # effort over torque: masses of a URDF are not that far off
_OVER_LIMIT = 1.5


@dataclass(frozen=True)
class EffortUnit:
    """Unit of the efforts and why it is taken for that."""

    unit: Literal["N m", "A"]
    reason: str


def guess_effort_unit(prepared: PreparedRegression) -> EffortUnit:
    """Compare the recorded efforts with the torques of the URDF's masses, then with its limits."""
    peaks = np.max(
        [np.abs(motion.signals.torque).max(axis=0) for motion in prepared.motions], axis=0
    )
    names = prepared.configuration.robot.joints
    if prepared.model.robot.has_inertials:
        ratios = _ratios(prepared)
        if ratios:
            middle = float(np.median(list(ratios.values())))
            listed = ", ".join(f"{names[joint]} {ratio:.2g}" for joint, ratio in ratios.items())
            measured = f"effort over the torque that the URDF's masses need: {listed}"
            if _SAME[0] <= middle <= _SAME[1]:
                return EffortUnit("N m", measured)
            if middle < 0.0:
                return EffortUnit("A", f"{measured}: the sign is opposite, see effort_scale")
            return EffortUnit("A", f"{measured}: not a torque, probably a motor current")
    return _from_limits(peaks, prepared.model.robot.limits, names)


def _ratios(prepared: PreparedRegression) -> dict[int, float]:
    """Effort over the torque of the URDF's masses, of the joints where that can be said.

    Friction and the inertia of the joint's own drive, which no URDF gives, are left free: the ratio
    is seen on gravity and on the other joints' motion (Frisch and Waugh's partial regression).
    """
    base = prepared.model.base
    given = prepared.model.given_without_friction
    friction = np.array([name.startswith(_FRICTION) for name in base.names])
    ratios = {}
    for joint, rows in enumerate(observation_rows(prepared.model, prepared.motions)):
        drive = re.compile(rf"\bIa{joint + 1}\b")
        own = np.array([bool(drive.search(text)) for text in base.expressions])
        if len(rows) < _LEAST_ROWS:
            continue
        free = np.column_stack([rows.matrix[:, (friction | own)[rows.columns]], np.ones(len(rows))])
        torque = _without(free, rows.matrix @ given[rows.columns])
        effort = _without(free, rows.torque)
        energy = float(torque @ torque)
        if energy <= 0.0:
            continue
        ratio = float(torque @ effort) / energy
        residual = effort - ratio * torque
        deviation = float(np.std(residual)) / np.sqrt(energy)
        share = (
            ratio**2 * energy / max(float(np.sum((rows.torque - rows.torque.mean()) ** 2)), 1e-300)
        )
        if share > _LEAST_SHARE and abs(ratio) > _LEAST_RATIO * deviation:
            ratios[joint] = ratio
    return ratios


def _without(columns: FloatArray, signal: FloatArray) -> FloatArray:
    """What of a signal no combination of the columns explains."""
    return np.asarray(signal - columns @ np.linalg.lstsq(columns, signal, rcond=None)[0])


def _from_limits(peaks: FloatArray, limits: JointLimits, names: list[str]) -> EffortUnit:
    known = np.isfinite(limits.effort) & (limits.effort > 0.0)
    if not known.any():
        return EffortUnit(
            "N m", "not known: the URDF has neither masses nor effort limits to compare with"
        )
    shares = np.where(known, peaks / np.where(known, limits.effort, 1.0), 0.0)
    most = int(np.argmax(shares))
    text = f"largest effort of {names[most]} is {100 * shares[most]:.2g} % of the URDF's limit"
    if shares[most] > _OVER_LIMIT:
        return EffortUnit("A", f"{text}: not a torque")
    return EffortUnit("N m", f"not sure: {text}, and the masses do not show in the efforts")
