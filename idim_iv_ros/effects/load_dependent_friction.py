"""Dry friction that grows with the load of the transmission."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from idim_iv_ros.compilation import kernel
from idim_iv_ros.effects.cause import GivenNumbers, Parameters, ParameterSpec
from idim_iv_ros.effects.contribution import Instant, Load, Torque, TorqueLaw, TorqueTerm
from idim_iv_ros.effects.effect import JointRange, Place, Shape, StructuralEffect
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_MOST = 1.0  # friction as large as the load: a screw that is driven from its nut
_LOADS = {
    Load.LINKS: "load: torque of the links",
    Load.MOTOR: "load: torque of the motor",
    Load.STATIC: "load: gravity and Coriolis torque",
}


@dataclass(frozen=True)
class LoadShape(Shape):
    """How friction follows the `load`, as a power of its share of the largest one."""

    exponent: float
    scale: float  # The largest load, N m
    # Whether both directions of the power flow have a coefficient of their own: a gear that is
    # driven loses less or more than one that drives
    two_directions: bool
    load: Load


@kernel
def _torque(p: FloatArray, at: Instant, state: FloatArray) -> Torque:
    """Torque for the simulator from p = (driving, driven, exponent, scale)."""
    share = p[0] if at.load * at.direction > 0.0 else p[1]
    return Torque(share * p[3] * (abs(at.load) / p[3]) ** p[2], 0.0, 0.0, 0.0)


class LoadDependentFriction(StructuralEffect[LoadShape]):
    """sign(dq) · scale (|τ| / scale)^exponent · (driving or driven); τ: torque of the links."""

    name = "load_dependent_friction"
    order = 40
    part = "friction"
    typical = 0.1  # of the load: 3 to 40 %
    family = "load"
    ends: ClassVar = {"exponent": (0.6, 1.6)}
    fixed = ("scale",)
    excitation = "one path with two payloads, or slowly through postures of high and low gravity"
    segments = ("range_sweep", "plateau")
    specs = (
        ParameterSpec("driving", "", "friction over load while the motor drives the load"),
        ParameterSpec("driven", "", "friction over load while the load drives the motor"),
        ParameterSpec("exponent", "", "power of load over scale", 1.0, "positive"),
        ParameterSpec("scale", "N m", "scale of the load", 1.0, "positive"),
        ParameterSpec(
            "motor_torque", "", "load taken as the motor's torque (1) or the links' (0)",
            bound="0 or 1",
        ),
        ParameterSpec(
            "static_torque", "", "load taken as the links' torque without accelerations (1)",
            bound="0 or 1",
        ),
    )  # fmt: skip
    law = TorqueLaw(_torque)
    laws = (law,)

    def grid(self, covered: JointRange) -> list[LoadShape]:
        """Exponents about one, one or two coefficients."""
        scale = covered.load
        if scale <= 0.0:
            return []
        return [
            LoadShape(exponent, scale, two_directions, load)
            for exponent in (0.8, 1.0, 1.3)
            for two_directions in (False, True)
            for load in Load
        ]

    def columns(self, motion: RobotMotion, place: Place, shape: LoadShape) -> Torques:
        """Friction of coefficients of one, by direction of the power flow where it has two."""
        v = motion.velocity[:, place.joint]
        if shape.load is Load.LINKS:
            load = motion.load[:, place.joint]
        else:
            both = motion.torque if shape.load is Load.MOTOR else motion.static_load
            load = both[:, place.joint]
        share = (np.abs(load) / shape.scale) ** shape.exponent
        whole = shape.scale * share * motion.slip[:, place.joint]
        if not shape.two_directions:
            return {place.joint: whole[:, None]}
        driving = load * v > 0.0
        return {place.joint: np.column_stack([whole * driving, whole * ~driving])}

    def impossible(self, shape: LoadShape, coefficients: FloatArray, covered: JointRange) -> str:
        """Friction that is larger than the load that makes it."""
        largest = float(max(coefficients[0], coefficients[-1]))
        return "" if largest <= _MOST else f"friction would be {largest:.2g} times the load"

    def meaning(self, shape: LoadShape) -> str:
        """Which torque is the load, in words."""
        return _LOADS[shape.load]

    def parameters(
        self, shape: LoadShape, coefficients: FloatArray, deviations: FloatArray
    ) -> Parameters:
        """Coefficients of friction when driving and when driven."""
        return self.numbers(
            driving=(coefficients[0], deviations[0]),
            driven=(coefficients[-1], deviations[-1]),
            exponent=(shape.exponent, None),
            scale=(shape.scale, None),
            motor_torque=(shape.load is Load.MOTOR, None),
            static_torque=(shape.load is Load.STATIC, None),
        )

    def refused(self, value: Mapping[str, float]) -> str:
        """Why parameters name two torques as the load; empty if they do not."""
        both = value["motor_torque"] == value["static_torque"] == 1.0
        return "motor_torque and static_torque are not both 1: one of them is the load" * both

    def contributions(self, given: GivenNumbers) -> list[TorqueTerm]:
        """Dry friction whose level follows the load."""
        values = given.values("driving", "driven", "exponent", "scale")
        load = Load.MOTOR if given.value["motor_torque"] == 1.0 else Load.LINKS
        load = Load.STATIC if given.value["static_torque"] == 1.0 else load
        return [TorqueTerm(self.law, values, friction=True, dry=True, load=load)]
