"""The control law that the robot runs, as actuators of a simulator can hold it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.configuration import ControllerSection
from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.simulation import SimulatedEffect, control_law
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class DriveLaw:
    """Gains from errors to torque, joint side, (n_joints,) each; None where no law is known.

    Attributes
    ----------
    kp, kd, ki : N m/rad, N m s/rad, N m/(rad s)
    velocity_reference : bool
        Whether the kd term acts on the error of the speed; otherwise on the speed.
    limit : N m
        Infinite where there is none.
    period, delay : s
        Of the control; from the command to the torque.
    beyond : tuple of str
        What of the law simulators have no element for.
    """

    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    velocity_reference: bool
    limit: FloatArray
    period: float
    delay: FloatArray
    known: bool
    beyond: tuple[str, ...]

    @property
    def in_actuators(self) -> bool:
        """Whether proportional and derivative actuators are the whole law."""
        return self.known and not self.beyond and not np.any(self.ki) and not np.any(self.delay)

    @property
    def words(self) -> str:
        """The law in words."""
        if not self.known:
            return "the control law is not known: give each motor its torque"
        slip = "(dq_ref - dq)" if self.velocity_reference else "(-dq)"
        integral = " + ki * integral of (q_ref - q)" if np.any(self.ki) else ""
        return f"torque = kp * (q_ref - q) + kd * {slip}{integral}, every {self.period:g} s"


def drive_law(
    section: ControllerSection, joints: Sequence[str], effects: Sequence[SimulatedEffect]
) -> DriveLaw:
    """Return the configured law with the gains, delays and limits that the robot really has.

    Parameters
    ----------
    section
        Of the configuration.
    joints
    effects
        Of the robot: those whose part is gains, delay or limit change the law.
    """
    n = len(joints)
    zeros = np.zeros(n)
    period = section.period or 0.001
    if section.type == "unknown":
        limit = np.full(n, np.inf) if section.torque_limit is None else section.torque_limit
        law = DriveLaw(
            zeros, zeros, zeros, False, np.array(limit), period, zeros + section.delay, False, ()
        )
    else:
        known = control_law(section, n)
        kp, kd, ki = (gain.copy() for gain in known.torque_gains)
        law = DriveLaw(
            kp,
            kd,
            ki,
            velocity_reference=known.uses_velocity_reference,
            limit=known.torque_limit.copy(),
            period=period,
            delay=zeros + known.delay,
            known=True,
            beyond=(),
        )
    for effect in effects:
        law = _changed(law, effect, list(joints))
    return law


def _changed(law: DriveLaw, effect: SimulatedEffect, joints: list[str]) -> DriveLaw:
    places = range(len(joints)) if effect.joint is None else [joints.index(effect.joint)]
    numbers, part = effect.parameters, part_of(effect.effect)
    if part == "delay":
        delay = law.delay.copy()
        delay[list(places)] += numbers.get("delay", 0.0)
        return replace(law, delay=delay)
    if part == "limit" and not numbers.get("slope", 0.0):
        limit = law.limit.copy()
        limit[list(places)] = np.minimum(limit[list(places)], numbers["knee"])
        return replace(law, limit=limit)
    if part != "gains" or not law.known:
        return law
    gains = {"kp": law.kp.copy(), "kd": law.kd.copy(), "ki": law.ki.copy()}
    beyond = list(law.beyond)
    for name, value in numbers.items():
        if name in gains:
            gains[name][list(places)] = value
        elif value:
            beyond.append(f"{name} {value:.4g} at {effect.joint}")
    return replace(law, kp=gains["kp"], kd=gains["kd"], ki=gains["ki"], beyond=tuple(beyond))
