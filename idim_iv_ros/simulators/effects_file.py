"""Effects of a simulated robot beyond its configuration: of a diagnosis, or written by hand."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar, Final, Literal

from idim_iv_ros.diagnosis.result.causes import Cause
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.documents import Document, Unsaved
from idim_iv_ros.effects.effect import StructuralEffect
from idim_iv_ros.effects.registry import BY_NAME, name_of
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import read_text
from idim_iv_ros.simulation import SimulatedEffect

EFFECTS_FORMAT: Final = "idim_iv_ros/effects/1"


@dataclass(frozen=True, kw_only=True)
class EffectsFile(Document):
    """A file of effects, by an export or a user.

    - `base_parameters`: values by name that differ from the configuration's
    - `effects`: with numbers as in docs/simulation.md; `native` ones are in the MJCF of the file
    - `recordings`: names of the recordings that they were found on
    """

    what: ClassVar[str] = "a file of effects"
    written_by: ClassVar[str] = "simulate"
    format: Literal["idim_iv_ros/effects/1"] = EFFECTS_FORMAT
    base_parameters: dict[str, float] = field(default_factory=dict)
    effects: tuple[SimulatedEffect, ...] = ()
    recordings: tuple[str, ...] = ()
    place: Unsaved[str] = ""  # of the base parameters, for messages: what stands before their names

    def changed(self, nominal: Mapping[str, float]) -> dict[str, float]:
        """Return base parameters by name, those in this file replaced.

        Raises UsageError: the robot does not have one of them.
        """
        for name in self.base_parameters:
            if name not in nominal:
                raise UsageError(
                    f"{self.place}{name} is not a base parameter of this robot; they are "
                    f"{', '.join(nominal)}"
                )
        return {**nominal, **self.base_parameters}


def effect_of_cause(cause: Cause, source: str, *, refit: bool = False) -> SimulatedEffect:
    """Return a cause of a diagnosis as a simulated effect; `source` names it in messages.

    `refit`: whether it is put into a refit, whose offset has the constants of effects.
    """
    effect = BY_NAME.get(cause.effect)
    there = effect.in_offset if refit and isinstance(effect, StructuralEffect) else ()
    numbers = {name: p.value for name, p in cause.parameters.items() if name not in there}
    return SimulatedEffect(cause.effect, cause.joint, numbers, cause.other_joint, source)


def constant_torques(
    joints: Sequence[str], values: Mapping[int, float]
) -> tuple[SimulatedEffect, ...]:
    """Return constant torques, N m (N) by number of the joint, as effects; none of zero."""
    return tuple(
        SimulatedEffect(name_of("offset"), joints[joint], {"offset": float(value)})
        for joint, value in values.items()
        if value != 0.0
    )


def read_effects(path: Path) -> EffectsFile:
    """Read a file of effects; a gap.json is converted to one.

    Raises UsageError: the file cannot be read, or is neither.
    """
    text = read_text(path, "the diagnosis")
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        raise UsageError(
            f"{path}: is XML, not effects: --effects takes effects.json or gap.json, "
            "--model an MJCF"
        )
    if EFFECTS_FORMAT in text:
        file = EffectsFile.from_json(text, str(path))
        effects = tuple(
            replace(effect, source=f"{path}: effects.{k}") for k, effect in enumerate(file.effects)
        )
        return replace(file, effects=effects, place=f"{path}: base_parameters.")
    gap = GapResult.from_json(text, str(path))
    effects = tuple(
        effect_of_cause(cause, f"{path}: causes.{k}") for k, cause in enumerate(gap.causes)
    )
    parameters = {name: parameter.value for name, parameter in gap.extended_parameters.items()}
    place = f"{path}: extended_parameters."
    return EffectsFile(
        base_parameters=parameters, effects=effects, recordings=gap.bags, place=place
    )
