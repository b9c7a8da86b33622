"""Control laws of the recorded robot, as the simulated loop runs them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from idim_iv_ros.configuration import ControllerSection
from idim_iv_ros.errors import UsageError
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class ControlLaw:
    """Sampled control law with zero-order hold, all values on the joint side.

    ``pd``: τ = kp e + kd (dq_ref − dq) + ki ∫e + feedforward, e = q_ref − q; without
    `velocity_reference` the kd term acts on −dq. ``cascade``: τ = drive_gain · kv (kp e − dq) +
    feedforward.

    Attributes
    ----------
    type : str
    kp, kd, ki, kv, drive_gain : (n_joints,)
        Those that a law does not have are zero (drive_gain: one).
    velocity_reference : bool
        Whether dq_ref enters a pd law.
    torque_limit : (n_joints,)
        N m (N); infinite where there is none. The integral stands still in saturation.
    period : float or None
        Of the control, s; None: one sample of the references.
    delay : float
        From the command to the torque on the joint, s.
    feedforward : (n_samples, n_joints) or None
        Torque added to the command, sampled like the references.
    speed_factor : float or None
        Of the first-order filter through which the law sees backward differences of the position
        over its period, v ← v + factor (Δq / period − v); 1 is no filter. None: the exact speed.
    """

    type: Literal["pd", "cascade"]
    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    kv: FloatArray
    drive_gain: FloatArray
    velocity_reference: bool
    torque_limit: FloatArray
    period: float | None
    delay: float
    feedforward: FloatArray | None = None
    speed_factor: float | None = None

    @property
    def torque_gains(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Gains (n_joints,) from position error, velocity error and its integral to torque."""
        if self.type == "pd":
            return self.kp, self.kd, self.ki
        velocity_gain = self.drive_gain * self.kv
        return velocity_gain * self.kp, velocity_gain, np.zeros_like(self.kp)

    @property
    def uses_velocity_reference(self) -> bool:
        """Whether the reference velocity enters the command."""
        return self.type == "pd" and self.velocity_reference

    def scaled(self, factor: FloatArray) -> "ControlLaw":
        """Multiply the torque gains by (n_joints,) factors (gain update of IDIM-IV).

        A loop whose inertia was guessed `factor` times the actual one keeps its bandwidth.
        """
        if self.type == "cascade":
            return replace(self, drive_gain=self.drive_gain * factor)
        return replace(self, kp=self.kp * factor, kd=self.kd * factor, ki=self.ki * factor)


def factor_of_lateness(lateness: float, period: float) -> float | None:
    """Filter of differences over a control period that is as late as another speed.

    A backward difference is half a period late, and a filter of factor f another (1 − f) / f
    periods (its group delay at low frequencies).

    Parameters
    ----------
    lateness, period
        s.

    Returns
    -------
    float or None
        0 < factor ≤ 1; None where differences over the period are later than that: the exact speed
        is then as near.
    """
    if lateness < 0.5 * period * (1.0 - 1e-9):
        return None
    return min(1.0, period / (lateness + 0.5 * period))


def control_period(section: ControllerSection, rates: Iterable[float]) -> float:
    """Period of the control, s: the configured one, or what the recordings tell of it.

    A robot has one controller, at least as fast as the fastest of its recordings.

    Parameters
    ----------
    rates
        Of the recordings, Hz.
    """
    return section.period if section.period is not None else 1.0 / max(rates)


def control_law(
    section: ControllerSection, n_joints: int, *, feedforward: FloatArray | None = None
) -> ControlLaw:
    """Build the law that a configuration describes.

    Raises
    ------
    UsageError
        The configuration says that the law is unknown; it must be fitted (`fit_controller`).
    """
    if section.type == "unknown":
        raise UsageError("controller.type is unknown: there is no law to simulate")

    def values(given: Sequence[float] | None, default: float) -> FloatArray:
        return np.full(n_joints, default) if given is None else np.asarray(given, dtype=float)

    return ControlLaw(
        type=section.type,
        kp=values(section.kp, 0.0),
        kd=values(section.kd, 0.0),
        ki=values(section.ki, 0.0),
        kv=values(section.kv, 0.0),
        drive_gain=values(section.drive_gain, 1.0),
        velocity_reference=section.velocity_reference,
        torque_limit=values(section.torque_limit, np.inf),
        period=section.period,
        delay=section.delay,
        feedforward=feedforward,
    )
