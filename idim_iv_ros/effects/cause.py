"""What every cause of the catalogue declares about itself, parametric or structural."""

import math
import re
from abc import ABC
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from idim_iv_ros.effects.contribution import Contribution, Element, Law, contribution_of
from idim_iv_ros.errors import UsageError

Kind = Literal["parametric", "structural"]
Family = Literal["velocity", "position", "load", "time", "frequency", "event"]
# Of the robot's model and its control: what a cause changes, where other steps ask for it.
Part = Literal[
    "", "friction", "drive", "link", "load", "gravity", "torque scale", "offset",
    "gains", "delay", "limit", "shaft", "play",
]  # fmt: skip
Bound = Literal["any", "positive", "not negative", "1 or -1", "0 or 1", "unbounded"]


@dataclass(frozen=True)
class EffectParameter:
    """A number of an effect; `std` is None where the recording does not determine it."""

    value: float
    std: float | None
    unit: str


Parameters = dict[str, EffectParameter]  # by the names that the specs of an effect give them


def surest(parameters: Mapping[str, EffectParameter], most: int) -> Parameters:
    """Return at most so many numbers, in their order: those that differ from zero most surely.

    A mass is first, and always among them: a load is recognised by it. All where no number is
    fitted.
    """
    ratios = {
        name: abs(parameter.value) / parameter.std
        for name, parameter in parameters.items()
        if parameter.std
    }
    chosen = sorted(ratios, key=lambda name: (name != "mass", -ratios[name]))[:most]
    shown = [name for name in parameters if name in chosen or not chosen]
    return {name: parameters[name] for name in sorted(shown, key=lambda name: name != "mass")}


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter that an effect has."""

    name: str  # As in gap.json; one that ends in _k means _1, _2, … that belong together
    unit: str  # Of a revolute joint
    words: str = ""  # What it is; empty where its name says it
    # For the simulator: None where it must be given, NaN where something else takes its place (the
    # configured gain, a stiffness from the inertias)
    default: float | None = 0.0
    bound: Bound = "any"  # Of numbers for the simulator; all but "unbounded" ones must be finite
    standard: str = ""  # Kind of the standard parameter that it changes (Fv); empty of others

    def check(self, value: float, name: str) -> None:
        """Refuse a value out of the bounds with a UsageError; `name` says whose it is."""
        if math.isnan(value) or (math.isinf(value) and self.bound != "unbounded"):
            raise UsageError(f"{name} is not a finite number")
        allowed = {
            "positive": value > 0.0,
            "not negative": value >= 0.0,
            "1 or -1": abs(value) == 1.0,
            "0 or 1": value in (0.0, 1.0),
        }
        if not allowed.get(self.bound, True):
            what = "not be negative" if self.bound == "not negative" else f"be {self.bound}"
            raise UsageError(f"{name} must {what}, not {value:g}")


@dataclass(frozen=True)
class GivenNumbers:
    """Checked parameters of one effect for the simulator, each of them present."""

    value: Mapping[str, float]  # By name, of those without a number at the end
    # Those that end in a number: one mapping for each number, by names that end in _k
    terms: Sequence[Mapping[str, float]]
    coulomb: float  # Friction of the joint, N m (N)

    def values(self, *names: str) -> tuple[float, ...]:
        """Values of the named parameters, in this order, for a compiled law."""
        return tuple(self.value[name] for name in names)


class Cause(ABC):
    """One cause of the catalogue: its names and numbers, what shows it, how it is simulated."""

    name: ClassVar[str]
    kind: ClassVar[Kind]
    # Place in the catalogue: where two explain equally well, the lower one counts.
    order: ClassVar[int]
    # What to record so that it shows: in words, and as kinds of segment of the designed motion
    # (`excitation.diagnosis`); where no segment shows it, `beyond_motion` says what does.
    excitation: ClassVar[str]
    segments: ClassVar[tuple[str, ...]] = ()
    beyond_motion: ClassVar[str] = ""
    joints_needed: ClassVar[int] = 1
    # Prior odds of it against an effect of the usual odds, before a recording is seen.
    prior_weight: ClassVar[float] = 1.0
    specs: ClassVar[tuple[ParameterSpec, ...]] = ()
    # Part of the robot that it changes; empty: physics that nothing else asks for by its part.
    part: ClassVar[Part] = ""
    acts_with: ClassVar[Part] = ""  # Part whose cause it can only act with; empty: by itself
    # Whether, at no joint in particular, it is put in before anything else is looked for.
    put_in_first: ClassVar[bool] = False
    # Simulator: whether the base parameters hold it already; whether it may be at all joints, none
    # being named; the compiled laws that its contributions use.
    in_base_parameters: ClassVar[bool] = False
    everywhere: ClassVar[bool] = False
    laws: ClassVar[tuple[Law, ...]] = ()
    dry: ClassVar[bool] = False  # Whether the torque of its law lets the joint stick
    # What of a MuJoCo model may hold it: elements of its joint, a tendon over two; empty: nothing.
    element_of: ClassVar[Literal["", "joint", "tendon"]] = ""

    def contributions(self, given: GivenNumbers) -> Iterable[Contribution]:
        """What it adds to a simulated joint; nothing where the base parameters hold it.

        By default its laws with the parameters in the order of `specs`: once, or for each term
        where the parameters are numbered.
        """
        names = [spec.name for spec in self.specs]
        for law in self.laws:
            for term in given.terms if names[0].endswith("_k") else [given.value]:
                values = tuple(term[name] for name in names)
                yield contribution_of(law, values, self.part == "friction", self.dry)

    def instead_of(self, kind: str, value: float) -> dict[str, float]:
        """Parameters with which the effect stands for a negative Fv or Fc; empty by default."""
        return {}

    def element(self, value: Mapping[str, float], low: float, high: float) -> Element | None:
        """Elements that are exactly the effect at a joint with this range; None where none are."""
        return None

    def refused(self, value: Mapping[str, float]) -> str:
        """Why parameters within their bounds contradict each other; empty if they do not."""
        return ""

    def spec(self, name: str) -> ParameterSpec | None:
        """Return the declaration of a parameter; that of wave_number_k for wave_number_2."""
        specs = {spec.name: spec for spec in self.specs}
        return specs.get(name) or specs.get(re.sub(r"_[1-9]\d*$", "_k", name))

    def standard_kind(self, name: str) -> str:
        """Return the kind of the standard parameter that a number changes; empty if it is none."""
        spec = self.spec(name)
        return "" if spec is None else spec.standard

    def parameter_words(self, name: str) -> str:
        """Return what a parameter is, with its number: ``sine_2`` as “… with the sine 2”.

        Where nothing is declared, its name without underscores says it.
        """
        spec = self.spec(name)
        if spec is None or not spec.words:
            return name.replace("_", " ")
        return f"{spec.words} {name.rsplit('_', 1)[1]}" if spec.name != name else spec.words

    def numbers(self, **numbers: tuple[float, float | None]) -> Parameters:
        """Return parameters with their units, from (value, std) by name."""
        made = {}
        for name, (value, std) in numbers.items():
            spec = self.spec(name)
            assert spec is not None, f"{self.name} declares no {name}"
            deviation = None if std is None else float(std)
            made[name] = EffectParameter(float(value), deviation, spec.unit)
        return made
