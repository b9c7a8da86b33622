"""The arms of the simulated fleet: how parameters are drawn, what is planted, what drifts."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Of the type: mean, and standard deviation from robot to robot (arm2 of config/, base parameters).
TYPE: dict[str, tuple[float, float]] = {
    "YY1": (0.7422, 0.015),
    "MX1": (1.6561, 0.025),
    "MZ1": (0.042, 0.012),
    "Fv1": (1.3876, 0.11),
    "Fc1": (1.5012, 0.12),
    "off1": (0.08, 0.06),
    "YY2": (0.0598, 0.002),
    "MX2": (0.27639, 0.005),
    "MZ2": (-0.0047, 0.003),
    "Ia2": (0.0885, 0.002),
    "Fv2": (0.36867, 0.03),
    "Fc2": (0.79396, 0.06),
    "off2": (0.018, 0.03),
}
# From bag to bag of one robot, relative: friction follows the temperature.
BETWEEN_BAGS = 0.015
LINK = 0.42  # m, length of the first link


@dataclass(frozen=True)
class Planted:
    """What makes one robot differ from its type, in all its bags.

    Attributes
    ----------
    words : str
    change : dict
        Added to base parameters.
    effects : tuple of (name, joint, parameters)
        Of the catalogue, beyond the base parameters.
    """

    words: str
    change: Mapping[str, float] = field(default_factory=dict)
    effects: tuple[tuple[str, str, Mapping[str, float]], ...] = ()


@dataclass(frozen=True)
class Drifting:
    """A parameter that changes from one bag on.

    Attributes
    ----------
    words : str
    parameter : str
    kind : str
        ``step`` or ``ramp``.
    first : float
        Share of the bags before it begins.
    size : float
        At the last bag.
    """

    words: str
    parameter: str
    kind: str
    first: float
    size: float

    def at(self, bag: int, bags: int) -> float:
        """Change in a bag, from 0."""
        begin = self.begin(bags)
        if bag < begin:
            return 0.0
        if self.kind == "step":
            return self.size
        return self.size * (bag - begin + 1) / (bags - begin)

    def begin(self, bags: int) -> int:
        """First bag that is affected, from 0."""
        return round(self.first * bags)


def payload(mass: float, x: float, z: float) -> dict[str, float]:
    """Change of the base parameters by a small ball at (x, z) m of the second link."""
    return {
        "YY1": mass * LINK**2,
        "MX1": mass * LINK,
        "YY2": mass * (x**2 + z**2),
        "MX2": mass * x,
        "MZ2": mass * z,
    }


PLANTED = (
    Planted("0.5 kg at the flange", payload(0.5, 0.34, 0.03)),
    Planted("Coulomb friction of joint_1 60 % higher", {"Fc1": 0.9}),
    Planted(
        "load-dependent friction at joint_2",
        effects=(("load_dependent_friction", "joint_2", {"driving": 0.1, "driven": 0.1}),),
    ),
    Planted(
        "backlash of 10 mrad at joint_2",
        effects=(("backlash", "joint_2", {"gap": 0.01, "stiffness": 8000.0}),),
    ),
    Planted("drive inertia of joint_2 a quarter higher: another motor", {"Ia2": 0.022}),
)
DRIFTING = (
    Drifting("Coulomb friction of joint_1 rises by 25 % at once", "Fc1", "step", 0.6, 0.375),
    Drifting("viscous friction of joint_2 rises slowly by 60 %", "Fv2", "ramp", 0.4, 0.22),
    Drifting("torque offset of joint_2 moves by 0.3 N m at once", "off2", "step", 0.3, 0.3),
)


def drawn(random: np.random.Generator) -> dict[str, float]:
    """Base parameters of a robot of the type."""
    return {name: float(random.normal(mean, std)) for name, (mean, std) in TYPE.items()}


def in_bag(
    parameters: Mapping[str, float], random: np.random.Generator, changes: Mapping[str, float]
) -> dict[str, float]:
    """Base parameters of a robot in one bag: friction of the day, and what has changed.

    Joints warm up for themselves; Coulomb and viscous friction of a joint do so together.
    """
    values = {name: value + changes.get(name, 0.0) for name, value in parameters.items()}
    for joint in ("1", "2"):
        warm = 1.0 + BETWEEN_BAGS * random.standard_normal()
        for kind in ("Fv", "Fc"):
            values[kind + joint] *= warm
    return values
