"""A robot that is controlled otherwise than its configuration says."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from idim_iv_ros.effects.cause import Cause, GivenNumbers, Parameters, ParameterSpec
from idim_iv_ros.effects.contribution import CommandParts, LawChange, reference_direction
from idim_iv_ros.effects.control_law import ControlLaw
from idim_iv_ros.types import FloatArray

if TYPE_CHECKING:  # a simulation, which has all effects, needs no filters
    from idim_iv_ros.signals.joint_side import JointSignals


class ControllerMismatch(Cause):
    """Recorded command = law + changes of gains + feedforward − lag · d(command)/dt."""

    name = "controller_mismatch"
    kind = "structural"
    order = 200
    part = "gains"
    excitation = "references that change quickly enough to leave a tracking error"
    segments = ("multisine",)
    # Names of the gain of the whole command and of its lag, and what of the law may be another.
    whole, lag = "gain", "lag"
    groups = (
        *("kp", "kd", "ki"),
        *("feedforward_acceleration", "feedforward_velocity", "feedforward_friction"),
        whole,
    )
    # Gains that are not named stay as configured.
    specs = (
        ParameterSpec("kp", "N m/rad", "kp in use", math.nan),
        ParameterSpec("kd", "N m s/rad", "kd in use", math.nan),
        ParameterSpec("ki", "N m/(rad s)", "ki in use", math.nan),
        ParameterSpec(
            "feedforward_acceleration", "kg m²", "feedforward over reference acceleration"
        ),
        ParameterSpec("feedforward_velocity", "N m s/rad", "feedforward over reference velocity"),
        ParameterSpec("feedforward_friction", "N m", "feedforward of dry friction"),
        ParameterSpec(lag, "s", "lag of the command", bound="not negative"),
    )

    def contributions(self, given: GivenNumbers) -> list[LawChange]:
        """The gains, feedforward and lag with which the simulated law differs."""
        return [LawChange(**given.value)]

    def parts(
        self, signals: "JointSignals", law: ControlLaw, joint: int, speed: FloatArray
    ) -> CommandParts:
        """Evaluate the law with a speed (n_samples,); the recording must have references."""
        reference = signals.position_reference
        assert reference is not None
        wanted = reference[:, joint]
        step = 1.0 / signals.rate
        if signals.velocity_reference is not None:
            wanted_speed = signals.velocity_reference[:, joint]
        else:
            wanted_speed = np.gradient(wanted, step)
        error = wanted - signals.position[:, joint]
        slip = wanted_speed - speed if law.velocity_reference else -speed
        integral = np.cumsum(error) * step
        kp, kd, ki = (float(gain[joint]) for gain in (law.kp, law.kd, law.ki))
        command = kp * error + kd * slip + ki * integral
        if law.feedforward is not None:
            command = command + law.feedforward[:, joint]
        wanted_acceleration = np.gradient(wanted_speed, step)
        groups = {
            "kp": error,
            "kd": slip,
            "ki": integral,
            "feedforward_acceleration": wanted_acceleration,
            "feedforward_velocity": wanted_speed,
            "feedforward_friction": reference_direction(wanted_speed),
            self.whole: command,
        }
        moving = np.gradient(signals.position[:, joint], step)
        late = np.column_stack([
            kp * speed,
            kd * np.gradient(moving, step),
            -kp * wanted_speed,
            -kd * wanted_acceleration,
        ])  # fmt: skip
        return CommandParts(command, np.gradient(command, step), late, groups)

    def parameters(
        self, law: ControlLaw, joint: int, changes: Mapping[str, tuple[float, float]]
    ) -> Parameters:
        """Return what the robot really uses, from (change, std) by group.

        The gains of a cascade are given as those from errors to torque.
        """
        given = {name: float(getattr(law, name)[joint]) for name in ("kp", "kd", "ki")}
        more, unsure = changes.get(self.whole, (0.0, 0.0))
        scaled = [name for name, value in given.items() if value != 0.0 and self.whole in changes]
        made = {}
        for name in (*scaled, *(name for name in changes if name != self.whole)):
            configured = given.get(name, 0.0)
            change, std = changes.get(name, (0.0, 0.0))
            std = math.hypot(std, configured * unsure)
            made[name] = configured * (1.0 + more) + change, std
        return self.numbers(**made)
