"""Effects for which MuJoCo has an element that does exactly the same.

The numbers of a joint (damping, stiffness) and of a tendon over two joints are what the effect's
own file says (`Cause.element`). Of the control: a delay is that of a motor, a limit beyond which
nothing more acts the range of its command, and gains are those of the actuators where no lag and no
feedforward is part of it. MuJoCo has no element for a constant torque, and its DC motor has LuGre
friction, another law than those of the catalogue. All these stay with `Effects`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from idim_iv_ros.effects.registry import BY_NAME, part_of
from idim_iv_ros.model import RobotModel
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulator_files.law import DriveLaw
from idim_iv_ros.simulator_files.robot import Coupled
from idim_iv_ros.types import FloatArray


@dataclass
class NativeEffects:
    """What the elements of a MuJoCo model have beyond friction and drive inertia."""

    # damping, stiffness: Coefficients of ∣v∣v and v³, N m s²/rad², N m s³/rad³; of q, q², q³
    damping: dict[int, FloatArray] = field(default_factory=dict)
    stiffness: dict[int, FloatArray] = field(default_factory=dict)
    couplings: list[Coupled] = field(default_factory=list)
    # Names of the joints or tendons that hold an effect, by its name
    listed: dict[str, list[str]] = field(default_factory=dict)

    def take(self, effect: SimulatedEffect, robot: RobotModel) -> bool:
        """Hold an effect; False where MuJoCo has no element for it."""
        cause = BY_NAME[effect.effect]
        if not cause.element_of or effect.joint is None:
            return False
        joint = robot.joints.index(effect.joint)
        low, high = float(robot.limits.lower[joint]), float(robot.limits.upper[joint])
        element = cause.element(effect.parameters, low, high)
        if element is None:
            return False
        name = effect.joint
        for numbers, values in (
            (self.damping, element.damping),
            (self.stiffness, element.stiffness),
        ):
            if values:
                numbers[joint] = numbers.get(joint, np.zeros(len(values))) + values
        if element.tendon:
            if effect.other_joint is None:
                return False
            tendon = Coupled(joint, robot.joints.index(effect.other_joint), *element.tendon)
            self.couplings.append(tendon)
            name = tendon.name(robot.joints)
        self.listed.setdefault(effect.effect, []).append(name)
        return True


def native_effects(
    effects: Sequence[SimulatedEffect], robot: RobotModel, law: DriveLaw
) -> tuple[NativeEffects, tuple[SimulatedEffect, ...]]:
    """Return what the model has natively, and all effects, marked where they are in it."""
    native = NativeEffects()
    marked = tuple(
        replace(effect, native=_in_control(effect, law) or native.take(effect, robot))
        for effect in effects
    )
    return native, marked


def _in_control(effect: SimulatedEffect, law: DriveLaw) -> bool:
    """Whether motors or actuators hold an effect; see `law.drive_law`."""
    part = part_of(effect.effect)
    if part == "limit":
        return not effect.parameters.get("slope", 0.0)
    return part == "delay" or (part == "gains" and law.configured and not law.beyond)
