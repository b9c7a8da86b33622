"""The control law that the robot runs, as actuators of a simulator can hold it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.configuration import ControllerSection
from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.simulation import SimulatedEffect, control_law
from idim_iv_ros.types import FloatArray


@dataclass(frozen=True)
class DriveLaw:
    """Gains from errors to torque, joint side, (n_joints,) each; zeros where no law is known."""

    # kp, kd, ki: N m/rad, N m s/rad, N m/(rad s)
    kp: FloatArray
    kd: FloatArray
    ki: FloatArray
    # Whether the kd term acts on the error of the speed; otherwise on the speed
    velocity_reference: bool
    limit: FloatArray  # N m: infinite where there is none
    # period, delay: s: of the control; from the command to the torque
    period: float
    delay: FloatArray
    configured: bool  # Whether a law is known
    beyond: tuple[str, ...]  # What of the law simulators have no element for

    @property
    def in_actuators(self) -> bool:
        """Whether proportional and derivative actuators are the whole law."""
        return (
            self.configured and not self.beyond and not np.any(self.ki) and not np.any(self.delay)
        )

    @property
    def words(self) -> str:
        """The law in words."""
        if not self.configured:
            return "the control law is not known: give each motor its torque"
        slip = "(dq_ref - dq)" if self.velocity_reference else "(-dq)"
        integral = " + ki * integral of (q_ref - q)" if np.any(self.ki) else ""
        return f"torque = kp * (q_ref - q) + kd * {slip}{integral}, every {self.period:g} s"


def drive_law(
    section: ControllerSection, joints: Sequence[str], effects: Sequence[SimulatedEffect]
) -> DriveLaw:
    """Return the configured law with the gains, delays and limits that the robot really has.

    These are in effects whose part is gains, delay or limit.
    """
    n = len(joints)
    law = None if section.type == "unknown" else control_law(section, n)
    gains = (np.zeros(n),) * 3 if law is None else law.torque_gains
    numbers = dict(zip(("kp", "kd", "ki"), (gain.copy() for gain in gains), strict=True))
    limit = np.full(n, np.inf) if section.torque_limit is None else np.array(section.torque_limit)
    delay, beyond = np.full(n, section.delay), []
    for effect in effects:
        value, part = effect.parameters, part_of(effect.effect)
        places = list(range(n)) if effect.joint is None else [list(joints).index(effect.joint)]
        if part == "delay":
            delay[places] += value.get("delay", 0.0)
        elif part == "limit" and not value.get("slope", 0.0):
            limit[places] = np.minimum(limit[places], value["knee"])
        elif part == "gains" and law is not None:
            for name, number in value.items():
                if name in numbers:
                    numbers[name][places] = number
                elif number:
                    beyond.append(f"{name} {number:.4g} at {effect.joint}")
    return DriveLaw(
        **numbers,
        velocity_reference=law is not None and law.uses_velocity_reference,
        limit=limit,
        period=section.period or 0.001,
        delay=delay,
        configured=law is not None,
        beyond=tuple(beyond),
    )
