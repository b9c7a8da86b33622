"""Torque or current?  What a driver calls effort, compared with what the URDF needs."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.estimation import observation_rows
from idim_iv_ros.model import JointLimits
from idim_iv_ros.preparation import PreparedRegression

FloatArray = NDArray[np.float64]

_FRICTION = ("Fv", "Fc", "off", "Fvm", "Fcm")
_LEAST_SHARE = 0.2  # of the torque's variance that the masses must explain
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
    """Effort over the torque of the URDF's masses, of the joints where that can be said."""
    base = prepared.model.base
    rigid = np.array([not name.startswith(_FRICTION) for name in base.names])
    given = prepared.model.given_without_friction
    ratios = {}
    for rows in observation_rows(prepared.model, prepared.motions):
        if len(rows) < 20:
            continue
        masses = rigid[rows.columns]
        torque = rows.matrix[:, masses] @ given[rows.columns][masses]
        columns = np.column_stack([torque, rows.matrix[:, ~masses], np.ones(len(rows))])
        solution = np.linalg.lstsq(columns, rows.torque, rcond=None)[0]
        residual = rows.torque - columns @ solution
        inverse = np.linalg.pinv(columns.T @ columns)
        deviation = float(np.sqrt(np.var(residual) * inverse[0, 0]))
        share = float(np.var(solution[0] * torque) / max(np.var(rows.torque), 1e-300))
        if share > _LEAST_SHARE and abs(solution[0]) > _LEAST_RATIO * deviation:
            ratios[rows.joint] = float(solution[0])
    return ratios


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
