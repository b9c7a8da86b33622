"""Effects that a robot has and its model leaves out, as values: names, parameters, checks.

Each adds a torque that the motor of one joint must overcome, moves what the encoder shows, or
changes the torque that acts for a command; equations in docs/simulation.md.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from idim_iv_ros.errors import UsageError

_REQUIRED = math.nan

# Default of each parameter; those without number are required. A name that ends in _k stands
# for _1, _2, … that belong together.
PARAMETERS: dict[str, dict[str, float]] = {
    "stribeck": {"excess": 0.0, "speed": _REQUIRED, "exponent": 2.0},
    "nonlinear_viscous": {"coefficient": 0.0, "power": 2.0},
    "asymmetric_friction": {"offset": 0.0, "viscous": 0.0},
    "load_dependent_friction": {
        "driving": 0.0,
        "driven": 0.0,
        "exponent": 1.0,
        "scale": 1.0,
        "motor_torque": 0.0,
    },
    "position_dependent_friction": {
        "wave_number_k": _REQUIRED,
        "sine_k": 0.0,
        "cosine_k": 0.0,
        "centre": 0.0,
        "width": 1.0,
        "height": 0.0,
    },
    "friction_drift": {"time_constant": _REQUIRED, "coulomb": 0.0, "viscous": 0.0},
    "presliding": {"span_k": _REQUIRED, "level_k": _REQUIRED},
    "backlash": {"gap": _REQUIRED, "stiffness": 0.0, "damping": -1.0},
    "elasticity": {"stiffness": _REQUIRED, "damping": 0.0},
    "time_delay": {"delay": 0.0},
    "torque_saturation": {"knee": _REQUIRED, "slope": 0.0},
    "position_ripple": {"wave_number_k": _REQUIRED, "sine_k": 0.0, "cosine_k": 0.0},
    "spring": {
        "constant": 0.0,
        "linear": 0.0,
        "quadratic": 0.0,
        "cubic": 0.0,
        "bent": 0.0,
        "centre": 0.0,
        "width": 1.0,
        "hardening": 1.0,
        "lowest": -math.inf,
        "highest": math.inf,
    },
    "encoder_eccentricity": {"sine": 0.0, "cosine": 0.0, "sine_2": 0.0, "cosine_2": 0.0},
    "joint_coupling": {"direction": 1.0, "coulomb": 0.0, "viscous": 0.0, "power": 1.0},
    "controller_mismatch": {
        "kp": _REQUIRED,
        "kd": _REQUIRED,
        "ki": _REQUIRED,
        "feedforward_acceleration": 0.0,
        "feedforward_velocity": 0.0,
        "lag": 0.0,
    },
    "torque_gain": {"factor": 1.0},
}

# Causes that are in the base parameters already.
_IN_BASE_PARAMETERS = (
    "payload",
    "link_inertia",
    "gravity_direction",
    "torque_offset",
    "friction_level",
    "drive_inertia",
)

_POSITIVE = (
    *("speed", "exponent", "power", "scale", "width", "time_constant", "span_k", "knee"),
    "factor",
)
_NOT_NEGATIVE = ("gap", "delay", "level_k", "slope", "lag")
_SWITCHES = ("hardening", "motor_torque")


@dataclass(frozen=True)
class SimulatedEffect:
    """One effect at one joint.

    Attributes
    ----------
    effect : str
        Name in the gap catalogue.
    joint : str or None
        None only where the effect is the same at all joints (`time_delay`, `torque_gain`), or is
        in the base parameters already.
    parameters : mapping of str to float
        In the units of the catalogue (docs/simulation.md); those left out are neutral.
    other_joint : str or None
        Second joint of a coupling.
    source : str
        What messages call it: file and key, or nothing.
    """

    effect: str
    joint: str | None
    parameters: Mapping[str, float]
    other_joint: str | None = None
    source: str = ""


@dataclass(frozen=True)
class JointEffect:
    """A checked effect at the joint of this index, every parameter present.

    `numbered` holds the parameters that end in a number, by number: {1: {"span_k": …}, …}.
    """

    effect: str
    joint: int
    other_joint: int
    value: dict[str, float]
    numbered: dict[int, dict[str, float]]


def joint_effects(
    effects: Sequence[SimulatedEffect], joints: Sequence[str]
) -> tuple[JointEffect, ...]:
    """Check effects and complete their parameters; those in the base parameters drop out.

    Raises
    ------
    UsageError
        An effect, joint or parameter that is not known, missing, or out of its range.
    """
    complete = []
    for one in effects:
        name = f"{one.source}: {one.effect}" if one.source else one.effect
        if one.effect in _IN_BASE_PARAMETERS:
            continue
        if one.effect not in PARAMETERS:
            known = ", ".join(sorted((*PARAMETERS, *_IN_BASE_PARAMETERS)))
            raise UsageError(f"{name} is not an effect that can be simulated; they are {known}")
        places = _places(one, name, list(joints))
        other = -1
        if one.effect == "joint_coupling":
            second = one.other_joint
            if second is None or second not in joints or second == one.joint:
                raise UsageError(f"{name}: other_joint {second} is not another joint of the robot")
            other = list(joints).index(second)
        value, numbered = _completed(one, name)
        complete += [JointEffect(one.effect, place, other, value, numbered) for place in places]
    return tuple(complete)


def _places(one: SimulatedEffect, name: str, joints: list[str]) -> list[int]:
    if one.joint is None and one.effect in ("time_delay", "torque_gain"):
        return list(range(len(joints)))
    if one.joint is None:
        raise UsageError(f"{name}: joint is missing")
    if one.joint not in joints:
        raise UsageError(f"{name}: no joint {one.joint}; they are {', '.join(joints)}")
    return [joints.index(one.joint)]


def _completed(
    one: SimulatedEffect, name: str
) -> tuple[dict[str, float], dict[int, dict[str, float]]]:
    known = PARAMETERS[one.effect]
    value = {key: default for key, default in known.items() if not key.endswith("_k")}
    numbered: dict[int, dict[str, float]] = {}
    for key, number in one.parameters.items():
        place = value
        family = key
        match = re.fullmatch(r"(\w+)_([1-9]\d*)", key)
        if match and key not in known and f"{match[1]}_k" in known:
            family = f"{match[1]}_k"
            place = numbered.setdefault(int(match[2]), {})
        elif key not in value:
            raise UsageError(f"{name}: unknown parameter {key}; they are {', '.join(known)}")
        _check(family, float(number), f"{name}: {key}")
        place[family] = float(number)
    # The gains of a mismatched controller stay as configured where they are not named.
    if one.effect != "controller_mismatch":
        for number_of, group in numbered.items():
            for key, default in known.items():
                if key.endswith("_k"):
                    group.setdefault(key, default)
            _none_missing(group, name, f"_{number_of}")
        _none_missing(value, name, "")
    if one.effect == "spring" and not value["lowest"] < value["highest"]:
        raise UsageError(f"{name}: lowest is not below highest")
    return value, numbered


def _none_missing(values: dict[str, float], name: str, number: str) -> None:
    for key, number_value in values.items():
        if math.isnan(number_value):
            raise UsageError(f"{name}: {key.removesuffix('_k')}{number} is missing")


def _check(family: str, number: float, name: str) -> None:
    if math.isnan(number) or (math.isinf(number) and family not in ("lowest", "highest")):
        raise UsageError(f"{name} is not a finite number")
    if family in _POSITIVE and number <= 0.0:
        raise UsageError(f"{name} must be positive, not {number:g}")
    if family in (*_NOT_NEGATIVE, "damping") and number < 0.0:
        raise UsageError(f"{name} must not be negative, not {number:g}")
    if family == "stiffness" and number <= 0.0:
        raise UsageError(f"{name} must be positive, not {number:g}")
    if family == "direction" and abs(number) != 1.0:
        raise UsageError(f"{name} must be 1 or -1, not {number:g}")
    if family in _SWITCHES and number not in (0.0, 1.0):
        raise UsageError(f"{name} must be 0 or 1, not {number:g}")
