"""Effects that a robot has and its model leaves out, as values: names, parameters, checks.

Each adds a torque that the motor of one joint must overcome, moves what the encoder shows, or
changes the torque that acts for a command; equations in docs/simulation.md. What an effect has and
does is in its file of `effects/`.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from idim_iv_ros.documents import Unsaved
from idim_iv_ros.effects.cause import Cause, GivenNumbers
from idim_iv_ros.effects.contribution import Contribution
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.errors import UsageError


@dataclass(frozen=True)
class SimulatedEffect:
    """An effect of the catalogue with the joint and the numbers with which it is simulated."""

    effect: str  # Name in the gap catalogue
    # None only where the effect may be at all joints (`Cause.everywhere`), or is in the base
    # parameters already
    joint: str | None = None
    # In the units of the catalogue (docs/simulation.md); those left out are neutral
    parameters: Mapping[str, float] = field(default_factory=dict)
    other_joint: str | None = None  # Second joint of a coupling
    source: Unsaved[str] = ""  # What messages call it: file and key, or nothing
    native: bool = False  # Whether the model of a simulator that it goes with has it already


@dataclass(frozen=True)
class JointEffect:
    """A checked effect at the joint of this index, every parameter present.

    `other_joint` is that of the second joint of a coupling, -1 for others.
    """

    cause: Cause
    joint: int
    other_joint: int
    value: dict[str, float]
    terms: tuple[dict[str, float], ...]

    def contributions(self, coulomb: float) -> tuple[Contribution, ...]:
        """What it adds to its joint, whose Coulomb friction is given in N m (N)."""
        return tuple(self.cause.contributions(GivenNumbers(self.value, self.terms, coulomb)))


def joint_effects(
    effects: Sequence[SimulatedEffect], joints: Sequence[str]
) -> tuple[JointEffect, ...]:
    """Check effects and complete their parameters; those in the base parameters drop out.

    Raises UsageError: an effect, joint or parameter that is not known, missing, or out of its
    range.
    """
    complete = []
    for one in effects:
        name = f"{one.source}: {one.effect}" if one.source else one.effect
        cause = BY_NAME.get(one.effect)
        if cause is None:
            names = ", ".join(sorted(BY_NAME))
            raise UsageError(f"{name} is not an effect that can be simulated; they are {names}")
        if cause.in_base_parameters:
            continue
        places = _places(one, cause, name, list(joints))
        other = -1
        if cause.joints_needed > 1:
            second = one.other_joint
            if second is None or second not in joints or second == one.joint:
                raise UsageError(f"{name}: other_joint {second} is not another joint of the robot")
            other = list(joints).index(second)
        value, terms = _completed(one.parameters, cause, name)
        complete += [JointEffect(cause, place, other, value, terms) for place in places]
    return tuple(complete)


def _places(one: SimulatedEffect, cause: Cause, name: str, joints: list[str]) -> list[int]:
    if one.joint is None and cause.everywhere:
        return list(range(len(joints)))
    if one.joint is None:
        raise UsageError(f"{name}: joint is missing")
    if one.joint not in joints:
        raise UsageError(f"{name}: no joint {one.joint}; they are {', '.join(joints)}")
    return [joints.index(one.joint)]


def _completed(
    given: Mapping[str, float], cause: Cause, name: str
) -> tuple[dict[str, float], tuple[dict[str, float], ...]]:
    """Parameters by name, and those of each term that is numbered."""
    value: dict[str, float] = {}
    numbered: dict[int, dict[str, float]] = {}
    for key, number in given.items():
        spec = cause.spec(key)
        if spec is None or key.endswith("_k"):
            names = ", ".join(spec.name for spec in cause.specs)
            raise UsageError(f"{name}: unknown parameter {key}; they are {names}")
        spec.check(float(number), f"{name}: {key}")
        term = re.search(r"_(\d+)$", key) if spec.name.endswith("_k") else None
        place = value if term is None else numbered.setdefault(int(term[1]), {})
        place[spec.name] = float(number)
    for spec in cause.specs:
        groups = numbered if spec.name.endswith("_k") else {0: value}
        for number_of, group in groups.items():
            if spec.default is None and spec.name not in group:
                missing = spec.name.replace("_k", f"_{number_of}")
                raise UsageError(f"{name}: {missing} is missing")
            group.setdefault(spec.name, spec.default if spec.default is not None else math.nan)
    reason = cause.refused(value)
    if reason:
        raise UsageError(f"{name}: {reason}")
    return value, tuple(numbered.values())
