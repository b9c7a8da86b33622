"""Which links and joints of a URDF no body can have, and which are only hard to believe.

A body has a mass of at least zero and a density that is nowhere negative. Then no principal
moment is negative, and none is larger than the sum of the other two (Featherstone, Rigid Body
Dynamics Algorithms, section 2.11). What breaks this is refused beyond two tolerances:

- the rounding of the digits that the file gives (a planar part of 0.25, 0.149 and 0.101 kg m²
  is written as 0.3, 0.1, 0.1), up to a tenth of the trace: with a larger one the digits tell
  nothing;
- a hundredth of the trace, or 1e-6 kg m², less than any drive's inertia: fitted and rounded
  tables that drive real robots are that far off, and the torque hardly changes.

What is within them, and what is possible but strange, is a doubt that the user is shown.
"""

import math
from collections.abc import Sequence

import numpy as np

from idim_iv_ros.model.urdf import MOVABLE, Inertial, Urdf, UrdfJoint, quoted

_OF_TRACE, _LARGEST_OF_TRACE = 0.01, 0.1
_SMALL_MOMENT = 1e-6  # kg m²
_ROUNDED = 1.5  # last digits: three moments, half a digit each
_EXACT = 1e-9  # of the trace: rounding of the computer
_HEAVY = 1e4  # kg
_NEAR = 1.0  # m: within this of its joint any centre of mass is believed


def judge_urdf(urdf: Urdf, identified: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return what is impossible and what is implausible, one sentence each.

    Parameters
    ----------
    identified
        Joints that move; of the others the axis and the limits do not matter.
    """
    impossible: list[str] = []
    doubts: list[str] = []
    reach = sum(float(np.linalg.norm(j.placement.translation)) for j in urdf.joints.values())
    for name, inertial in urdf.links.items():
        if inertial is not None:
            wrong, strange = _judge_inertial(inertial, max(reach, _NEAR))
            impossible += [f"link {quoted(name)}: {each}" for each in wrong]
            doubts += [f"link {quoted(name)}: {each}" for each in strange]
    for name in identified:
        joint = urdf.joints.get(name)
        if joint is not None and joint.type in MOVABLE:
            impossible += [f"joint {quoted(name)}: {each}" for each in _wrong_joint(joint)]
            doubts += [f"joint {quoted(name)}: {each}" for each in _strange_limits(joint)]
    return impossible, doubts


def _judge_inertial(inertial: Inertial, far: float) -> tuple[list[str], list[str]]:
    mass = inertial.mass
    if mass < 0.0:
        return [f"mass {mass:g} kg is negative"], []
    least, middle, largest = (float(value) for value in np.linalg.eigvalsh(inertial.inertia))
    trace = least + middle + largest
    missing = largest - middle - least
    size = max(abs(least), abs(largest))
    rounding = min(_ROUNDED * inertial.last_digit, _LARGEST_OF_TRACE * size)
    tolerance = max(_OF_TRACE * size, rounding, _SMALL_MOMENT)
    moments = f"principal moments {least:.3g}, {middle:.3g}, {largest:.3g} kg m²"
    rule = (
        "one is negative"
        if least < -_EXACT * size
        else "the largest exceeds the sum of the others (triangle inequality)"
    )
    if missing > tolerance:
        return [f"{moments}: {rule}; no body has that"], []
    doubts = []
    if missing > _EXACT * size:
        doubts.append(f"{moments}: {rule}, by no more than rounding may do")
    if mass == 0.0 and size > 0.0:
        doubts.append(f"moments of inertia up to {largest:.3g} kg m² without a mass")
    elif mass > 0.0 and math.sqrt(0.5 * max(trace, 0.0) / mass) > far:
        doubts.append(
            f"a moment of inertia of {largest:.3g} kg m² with {mass:g} kg: a radius of gyration of "
            f"{math.sqrt(0.5 * trace / mass):.3g} m on a robot of {far:.3g} m"
        )
    distance = float(np.linalg.norm(inertial.centre))
    if distance > far and mass > 0.0:
        doubts.append(f"centre of mass {distance:.3g} m from its joint on a robot of {far:.3g} m")
    if mass > _HEAVY:
        doubts.append(f"a mass of {mass:g} kg")
    return [], doubts


def _wrong_joint(joint: UrdfJoint) -> list[str]:
    wrong = []
    if float(np.linalg.norm(joint.axis)) < 1e-9:
        wrong.append("its axis is zero")
    lower, upper = joint.limits.get("lower", 0.0), joint.limits.get("upper", 0.0)
    if joint.type != "continuous" and lower > upper:
        wrong.append(f"lower limit {lower:g} is above upper limit {upper:g} {_unit(joint)}")
    for key, unit in (("velocity", f"{_unit(joint)}/s"), ("effort", _effort_unit(joint))):
        if joint.limits.get(key, 0.0) < 0.0:
            wrong.append(f"{key} limit {joint.limits[key]:g} {unit} is negative")
    for key, value in (("damping", joint.damping), ("friction", joint.friction)):
        if value < 0.0:
            wrong.append(f"{key} {value:g} is negative: friction takes energy out")
    return wrong


def _strange_limits(joint: UrdfJoint) -> list[str]:
    limits = joint.limits
    if not limits:
        return [] if joint.type == "continuous" else ["no <limit>: taken as unlimited"]
    zero = [key for key in ("velocity", "effort") if limits.get(key) == 0.0]
    if joint.type != "continuous" and limits.get("lower", 0.0) == limits.get("upper", 0.0):
        zero.insert(0, "position")
    return [f"{' and '.join(zero)} limit of zero: taken as none"] if zero else []


def _unit(joint: UrdfJoint) -> str:
    return "m" if joint.type == "prismatic" else "rad"


def _effort_unit(joint: UrdfJoint) -> str:
    return "N" if joint.type == "prismatic" else "N m"
