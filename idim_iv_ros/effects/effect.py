"""What every structural effect declares about itself: physics that the nominal model lacks."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, Literal, TypeVar, cast

import numpy as np

from idim_iv_ros.effects.cause import Cause, Family, Parameters
from idim_iv_ros.effects.motion import RobotMotion, Torques
from idim_iv_ros.types import FloatArray

_MOST_TERMS = 3  # of a shape that has a tuple of numbers
_LEAST_SPEED = 0.25  # rad/s: Stribeck speeds of arms are 0.02 to 0.3 rad/s


@dataclass(frozen=True)
class Shape:
    """What enters the torque of an effect otherwise than linearly: fields of floats and choices.

    A choice (`bool`) is not searched in small steps, and a tuple of floats belongs to terms that
    are added (see `StructuralEffect.longer`).
    """

    @property
    def numbers(self) -> tuple[float, ...]:
        """All numbers of the shape in the order of its fields, choices as 0 and 1."""
        fields = (value if isinstance(value, tuple) else (value,) for value in vars(self).values())
        return tuple(float(number) for field in fields for number in field)


S = TypeVar("S", bound=Shape)


@dataclass(frozen=True)
class Place:
    """The joint of an effect, from 0, and the second one of a coupling."""

    joint: int
    other: int | None = None

    @property
    def joints(self) -> tuple[int, ...]:
        """The joint, or both joints of a coupling."""
        return (self.joint,) if self.other is None else (self.joint, self.other)


@dataclass(frozen=True)
class JointRange:
    """What the recordings cover at one joint, and what is small and large there."""

    low: float  # Lowest position, rad (m)
    high: float  # Highest position, rad (m)
    slowest: float  # Speed below which rows do not count, rad/s (m/s)
    fastest: float  # Highest speed, rad/s (m/s)
    mean_speed: float  # Mean modulus, rad/s (m/s)
    load: float  # Largest torque of the links, N m (N)
    torque: float  # Largest torque of the joint, N m (N)
    dry_friction: float  # Its level, N m (N)
    inertia: float  # Mean of the links' about the joint, kg m² (kg)
    lever: float  # 1 for a revolute joint, 0.1 for a prismatic one: metres that count as a radian
    duration: float  # s, from the start of the first to the end of the last recording
    longest: float  # s, of the longest recording
    row_rate: float  # Hz
    sticking: bool  # Whether the closed loop is simulated, which shows where the joint sticks
    left_out: bool  # Whether the torque says nothing of the robot

    @property
    def span(self) -> float:
        """Range of the positions, rad (m)."""
        return self.high - self.low

    @property
    def length(self) -> str:
        """Unit of the position: rad, or m where the `lever` is that of a prismatic joint."""
        return "rad" if self.lever == 1.0 else "m"


@dataclass(frozen=True)
class ShareOf:
    """A torque as a share of the joint's dry friction or of its largest torque."""

    of: Literal["dry friction", "peak"]
    share: float

    def torque(self, covered: JointRange) -> float:
        """The torque at a joint, N m (N)."""
        return self.share * (covered.dry_friction if self.of == "dry friction" else covered.torque)


class StructuralEffect(Cause, Generic[S]):
    """A physical effect that the simulator may lack.

    Its torque is linear in its coefficients for a given *shape* (a speed, a wave number, a delay);
    shapes are searched on a grid and refined.
    """

    kind = "structural"
    family: ClassVar[Family]
    # Names of the coefficients, in their order; those that end in _k are of each of several terms.
    # Numbers of the shape are called like its fields.
    linear: ClassVar[tuple[str, ...]] = ()
    signed: ClassVar[bool] = False  # Whether physics allows coefficients of either sign
    # Ends of numbers of the shape in the search, and numbers that it does not move.
    ends: ClassVar[Mapping[str, tuple[float, float]]] = {}
    fixed: ClassVar[tuple[str, ...]] = ()
    # Coefficients that a refit has as the offset of the joint.
    in_offset: ClassVar[tuple[str, ...]] = ()
    # Whether the shape may vary beside the coefficients; not where one is its change.
    free_shape: ClassVar[bool] = True
    # Where its size sits: in the coefficients, in one coefficient that scales a shape (which holds
    # for factors about one only), or in the first number of the shape, the coefficient being one.
    size_in: ClassVar[Literal["coefficients", "scale", "shape"]] = "coefficients"
    # Middle (geometric) of the largest torques that are typical of arms, or (a plain number) of the
    # numbers that are fitted; see `plausible`.
    typical: ClassVar[ShareOf | float | None] = None
    # Whether it acts on few rows only, beyond a knee: the diagnosis asks that they be there.
    beyond_knee: ClassVar[bool] = False
    # Whether it shows only where a joint moves fast enough for friction to bend with the speed.
    bends_with_speed: ClassVar[bool] = False
    # Whether a simulator that softens dry friction leaves nothing to see of it.
    lost_where_softened: ClassVar[bool] = False

    def places(self, joints: int) -> list[Place]:
        """Joints or pairs of joints at which the effect may act; all joints by default."""
        return [Place(joint) for joint in range(joints)]

    def grid(self, covered: JointRange) -> Sequence[S]:
        """Shapes with which the search begins; by default one, without numbers."""
        return cast(Sequence[S], [Shape()])

    def branches(self, grid: Sequence[S]) -> list[Sequence[S]]:
        """Parts of the grid that are searched apart, for shapes of different kinds."""
        return [grid]

    def columns(self, motion: RobotMotion, place: Place, shape: S) -> Torques:
        """Torque of unit coefficients, (s, k) by joint: what the motor must bring up more.

        An effect has this, or makes the columns of many shapes for less in `torques`.
        """
        return self.torques(motion, place, [shape])[0]

    def torques(self, motion: RobotMotion, place: Place, shapes: Sequence[S]) -> list[Torques]:
        """`columns` of several shapes."""
        return [self.columns(motion, place, shape) for shape in shapes]

    def names(self, shape: S) -> tuple[str, ...]:
        """Names of the coefficients of a shape: `linear`, with numbers for several terms."""
        terms = next((len(v) for v in vars(shape).values() if isinstance(v, tuple)), 0)
        numbered = [name.replace("_k", f"_{k + 1}") for k in range(terms) for name in self.linear]
        return tuple(numbered) or self.linear

    def parameters(self, shape: S, coefficients: FloatArray, deviations: FloatArray) -> Parameters:
        """Numbers that mean something to an engineer; deviations are those of the coefficients.

        By default the coefficients by their `names` and the fields of the shape, as far as `specs`
        has them and in its order; a field in the plural (spans) is one number a term (span_1).
        """
        pairs = zip(coefficients, deviations, strict=True)
        given: dict[str, tuple[float, float | None]] = {}
        given |= zip(self.names(shape), pairs, strict=False)
        for field, value in vars(shape).items():
            if isinstance(value, tuple):
                singular = field.removesuffix("s")
                given |= {f"{singular}_{k}": (v, None) for k, v in enumerate(value, start=1)}
            else:
                given[field] = value, None
        counted = {
            (name.rpartition("_")[2] * (spec.name != name), self.specs.index(spec)): name
            for name in given
            if (spec := self.spec(name)) is not None
        }  # terms one after the other
        return self.numbers(**{name: given[name] for _, name in sorted(counted.items())})

    def admissible(self, shape: S, coefficients: FloatArray) -> bool:
        """Whether physics allows these coefficients: none is negative, unless they are `signed`."""
        return self.signed or bool(np.all(coefficients >= 0.0))

    def neighbours(self, shape: S, step: float, covered: JointRange) -> list[S]:
        """Shapes with one number larger or smaller by the factor 1 + step, within its bounds."""
        near = []
        for name, given in vars(shape).items():
            low, high = self.ends.get(name, (-np.inf, np.inf))
            for value in [] if name in self.fixed else _varied(given, 1.0 + step):
                bounded = value if isinstance(value, tuple) else min(max(value, low), high)
                near.append(replace(shape, **{name: bounded}))
        return near

    def cannot_show(self, covered: JointRange) -> str:
        """Why a joint's motion cannot show it whatever its size; empty where it may.

        What holds for every effect is in `diagnosis.identifiability.cannot_show`.
        """
        if not self.bends_with_speed or covered.fastest >= _LEAST_SPEED * covered.lever:
            return ""
        speed = f"{covered.fastest:.2g} {covered.length}/s"
        return f"the joint moves at most {speed}: too slow to show bent friction"

    def plausible(
        self, shape: S, coefficients: FloatArray, torque: float, covered: JointRange
    ) -> bool:
        """Whether arms may well have it in this size: any, unless `typical` bounds it.

        An effect of which only larger sizes would be seen may be there without a trace. `torque`:
        the largest that it adds, N m (N).
        """
        most = self.typical
        if most is None or isinstance(most, ShareOf):
            return most is None or torque <= most.torque(covered)
        fitted = self.parameters(shape, coefficients, np.zeros(len(coefficients))).values()
        return all(abs(number.value) <= most for number in fitted if number.std is not None)

    def impossible(self, shape: S, coefficients: FloatArray, covered: JointRange) -> str:
        """Why no arm has the effect in this size; empty where one may have, as by default.

        Wider than `plausible`, which says what is common: numbers that the search fits and that no
        hardware has belong to something else, and the effect is not named.
        """
        return ""

    def meaning(self, shape: S) -> str:
        """Which kind of the effect a shape is, in words; empty where there is one kind only."""
        return ""

    def size_in_words(self, shape: S, coefficients: FloatArray, torque: float) -> str:
        """First number that is fitted and not zero, with its unit and the largest torque."""
        numbers = self.parameters(shape, coefficients, np.zeros(len(coefficients)))
        for name, number in numbers.items():
            if number.std is not None and number.value != 0.0:
                plain = number.unit == "N m" or torque <= 0.0
                size = f"{number.value:.2g} {number.unit}".rstrip()
                more = "" if plain else f" (up to {torque:.2g} N m)"
                return f"{name.replace('_', ' ')} = {size}{more}"
        return f"{torque:.2g} N m"

    def longer(self, shape: S, covered: JointRange) -> list[S]:
        """Shapes with a further term at the end, up to three in all."""
        terms = next((name for name, v in vars(shape).items() if isinstance(v, tuple)), "")
        if not terms or len(getattr(shape, terms)) >= _MOST_TERMS:
            return []
        return [
            replace(shape, **{terms: getattr(shape, terms) + getattr(term, terms)})
            for term in self.grid(covered)
            if type(term) is type(shape)
        ]


def _varied(given: object, factor: float) -> list[Any]:
    """A field's value times and divided by a factor; of a tuple, one number at a time."""
    if isinstance(given, tuple):
        return [
            (*given[:k], value, *given[k + 1 :])
            for k, number in enumerate(given)
            for value in (number * factor, number / factor)
        ]
    return [given * factor, given / factor] if isinstance(given, float) else []


# One of any shape, for those who hand its shapes back to it.
Effect = StructuralEffect[Any]
