"""Effects that a robot has and its model leaves out, as values: names, parameters, contributions.

Each adds a torque that the motor of one joint must overcome, moves what the encoder shows, or
changes the torque that acts for a command; equations in docs/simulation.md. What an effect has and
does is in its file of `effects/`.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from idim_iv_ros.documents import Unsaved
from idim_iv_ros.effects.cause import Cause, GivenNumbers
from idim_iv_ros.effects.contribution import Contribution, CouplingTerm, DriveCurve
from idim_iv_ros.effects.registry import BY_NAME
from idim_iv_ros.errors import UsageError
from idim_iv_ros.types import FloatArray

_Kind = TypeVar("_Kind", bound=Contribution)


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
class JointContributions:
    """What effects add to a robot: contributions with their joints (the second one, or -1)."""

    items: tuple[tuple[int, int, Contribution], ...]
    joints: frozenset[int]  # That have an effect, also one whose numbers add nothing

    def of(self, kind: type[_Kind]) -> Iterator[tuple[int, _Kind]]:
        """Pairs of a joint and its contribution, of all contributions of a kind."""
        return ((joint, part) for joint, _, part in self.items if isinstance(part, kind))

    @property
    def curves(self) -> list[tuple[int, DriveCurve]]:
        """Changes of commands in the order in which they act, with their joints."""
        return sorted(self.of(DriveCurve), key=lambda item: item[1].law.rank)

    @property
    def couplings(self) -> list[tuple[int, int, CouplingTerm]]:
        """Couplings with the two joints between which they act."""
        return [(a, b, part) for a, b, part in self.items if isinstance(part, CouplingTerm)]


def contributions_of(
    effects: Sequence[SimulatedEffect], joints: Sequence[str], coulomb: FloatArray | None = None
) -> JointContributions:
    """Check effects and return what they add to joints; those in the base parameters add nothing.

    - `coulomb`: (n_joints,) Coulomb friction, N m (N); None: zero

    Raises UsageError: an effect, joint or parameter that is not known, missing, or out of its
    range.
    """
    items: list[tuple[int, int, Contribution]] = []
    affected: set[int] = set()
    for one in effects:
        name = f"{one.source}: {one.effect}" if one.source else one.effect
        cause = BY_NAME.get(one.effect)
        if cause is None:
            names = ", ".join(sorted(BY_NAME))
            raise UsageError(f"{name} is not an effect that can be simulated; they are {names}")
        if cause.in_base_parameters:
            continue
        at_all = one.joint is None and cause.everywhere
        if one.joint is None and not at_all:
            raise UsageError(f"{name}: joint is missing")
        if one.joint is not None and one.joint not in joints:
            raise UsageError(f"{name}: no joint {one.joint}; they are {', '.join(joints)}")
        places = [k for k, joint in enumerate(joints) if at_all or joint == one.joint]
        other = -1
        if cause.joints_needed > 1:
            second = one.other_joint
            if second is None or second not in joints or second == one.joint:
                raise UsageError(f"{name}: other_joint {second} is not another joint of the robot")
            other = list(joints).index(second)
            affected.add(other)
        affected.update(places)
        value, terms = _completed(one.parameters, cause, name)
        for place in places:
            friction = 0.0 if coulomb is None else float(coulomb[place])
            parts = cause.contributions(GivenNumbers(value, terms, friction))
            items += [(place, other, part) for part in parts]
    return JointContributions(tuple(items), frozenset(affected))


def _completed(
    given: Mapping[str, float], cause: Cause, name: str
) -> tuple[dict[str, float], list[dict[str, float]]]:
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
        for number_of, group in (numbered if spec.name.endswith("_k") else {0: value}).items():
            if spec.default is None and spec.name not in group:
                missing = spec.name.replace("_k", f"_{number_of}")
                raise UsageError(f"{name}: {missing} is missing")
            group.setdefault(spec.name, spec.default if spec.default is not None else math.nan)
    reason = cause.refused(value)
    if reason:
        raise UsageError(f"{name}: {reason}")
    return value, list(numbered.values())
