"""Effects for which MuJoCo has an element that does exactly the same.

======================  ==========================================================================
effect                  element
======================  ==========================================================================
`nonlinear_viscous`     second and third number of a joint's `damping` (power 2 or 3)
`spring`                `stiffness` of a joint, a polynomial, where its range is never left
`joint_coupling`        `damping` and `frictionloss` of a fixed tendon over both joints (power 1)
`time_delay`            `delay` and `nsample` of a motor
`torque_saturation`     range of the command, where nothing more acts beyond the knee
`controller_mismatch`   gains of the actuators, where no lag and no feedforward is part of it
======================  ==========================================================================

It has none for a constant torque. Its DC motor has LuGre friction, another law than the Stribeck
curve and the Maxwell slip of the catalogue. All these stay with `Effects`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from idim_iv_ros.effects.registry import part_of
from idim_iv_ros.model import RobotModel
from idim_iv_ros.model.mjcf_ties import COUPLING, DAMPING, SPRING
from idim_iv_ros.simulator_files.law import DriveLaw
from idim_iv_ros.simulators.effects_file import PlantedEffect


@dataclass(frozen=True)
class Coupled:
    """A fixed tendon over two joints: q_first + direction q_second."""

    first: int
    second: int
    direction: float
    damping: float
    friction: float
    inertia: float = 0.0


@dataclass
class NativeEffects:
    """What the elements of a MuJoCo model have beyond friction and drive inertia.

    Attributes
    ----------
    damping : dict of joint index to list of float
        Coefficients of ∣v∣v and v³, N m s²/rad², N m s³/rad³.
    stiffness : dict of joint index to list of float
        Coefficients of q, q², q³.
    couplings : list of Coupled
    """

    damping: dict[int, list[float]] = field(default_factory=dict)
    stiffness: dict[int, list[float]] = field(default_factory=dict)
    couplings: list[Coupled] = field(default_factory=list)

    @property
    def joints(self) -> dict[str, list[int]]:
        """Joints whose elements hold an effect, by its name."""
        found = {DAMPING: list(self.damping), SPRING: list(self.stiffness)}
        return {effect: joints for effect, joints in found.items() if joints}


def native_effects(
    effects: Sequence[PlantedEffect], robot: RobotModel, law: DriveLaw
) -> tuple[NativeEffects, tuple[PlantedEffect, ...]]:
    """Return what the model has natively, and all effects, marked where they are in it."""
    found = NativeEffects()
    marked = tuple(replace(effect, native=_taken(effect, robot, law, found)) for effect in effects)
    return found, marked


def _taken(effect: PlantedEffect, robot: RobotModel, law: DriveLaw, found: NativeEffects) -> bool:
    """Put an effect into `found`; False where MuJoCo has no element for it."""
    numbers, part = effect.parameters, part_of(effect.effect)
    if part == "delay":
        return True
    if part == "limit":
        return not numbers.get("slope", 0.0)
    if part == "gains":
        return law.known and not law.beyond
    if effect.joint is None:
        return False
    joint = robot.joints.index(effect.joint)
    if effect.effect == DAMPING and numbers.get("power", 2.0) in (2.0, 3.0):
        place = int(numbers.get("power", 2.0)) - 2
        found.damping.setdefault(joint, [0.0, 0.0])[place] += numbers.get("coefficient", 0.0)
        return True
    if effect.effect == SPRING:
        return _spring(effect, robot, joint, found)
    if effect.effect == COUPLING:
        return _coupling(effect, robot, joint, found)
    return False


def _spring(effect: PlantedEffect, robot: RobotModel, joint: int, found: NativeEffects) -> bool:
    numbers = effect.parameters
    low, high = robot.limits.lower[joint], robot.limits.upper[joint]
    lowest, highest = numbers.get("lowest", -math.inf), numbers.get("highest", math.inf)
    if numbers.get("bent") or numbers.get("constant") or low < lowest or high > highest:
        return False
    own = found.stiffness.setdefault(joint, [0.0, 0.0, 0.0])
    for place, name in enumerate(("linear", "quadratic", "cubic")):
        own[place] += numbers.get(name, 0.0)
    return True


def _coupling(effect: PlantedEffect, robot: RobotModel, joint: int, found: NativeEffects) -> bool:
    numbers = effect.parameters
    coulomb, viscous = numbers.get("coulomb", 0.0), numbers.get("viscous", 0.0)
    if numbers.get("power", 1.0) != 1.0 or coulomb < 0.0 or viscous < 0.0:
        return False
    if effect.other_joint is None:
        return False
    other = robot.joints.index(effect.other_joint)
    direction = numbers.get("direction", 1.0)
    found.couplings.append(Coupled(joint, other, direction, viscous, coulomb))
    return True
