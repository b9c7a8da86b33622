"""What a simulated robot has beyond its configuration: a diagnosis, or effects written by hand."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Final, Literal

from idim_iv_ros.diagnosis.result import GapResult
from idim_iv_ros.documents import Document
from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import read_text
from idim_iv_ros.simulation import SimulatedEffect

EFFECTS_FORMAT: Final = "idim_iv_ros/effects/1"
_LARGEST = 50.0  # MB


@dataclass(frozen=True)
class PlantedEffect:
    """One effect at a joint, or at all; numbers as in docs/simulation.md.

    `native`: whether the MJCF that the file goes with has it already, so that
    `simulators.mujoco.Effects` passes it over.
    """

    effect: str
    joint: str | None = None
    other_joint: str | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    native: bool = False


@dataclass(frozen=True, kw_only=True)
class EffectsFile(Document):
    """A file of effects that a user writes.

    Attributes
    ----------
    format : str
    base_parameters : dict of str to float
        Those that differ from the configuration's, by name.
    effects : tuple of PlantedEffect
    recordings : tuple of str
        Names of those that they were found on.
    """

    what: ClassVar[str] = "a file of effects"
    written_by: ClassVar[str] = "simulate"
    format: Literal["idim_iv_ros/effects/1"] = EFFECTS_FORMAT
    base_parameters: dict[str, float] = field(default_factory=dict)
    effects: tuple[PlantedEffect, ...] = ()
    recordings: tuple[str, ...] = ()


@dataclass(frozen=True)
class ExtendedModel:
    """Base parameters that differ from the configuration's, and effects beyond them.

    `key`: where the parameters stand in the file; `recordings`: names of those they are from.
    """

    parameters: dict[str, float]
    effects: tuple[SimulatedEffect, ...]
    key: str
    recordings: tuple[str, ...]


def read_effects(path: Path) -> ExtendedModel:
    """Read a gap.json, or a file of effects.

    Raises
    ------
    UsageError
        The file cannot be read, or is neither.
    """
    text = read_text(path, "the diagnosis", megabytes=_LARGEST)
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        raise UsageError(
            f"{path}: is XML, not effects: --effects takes effects.json or gap.json, "
            "--model an MJCF"
        )
    if EFFECTS_FORMAT in text:
        planted = EffectsFile.from_json(text, str(path))
        effects = tuple(
            SimulatedEffect(
                effect.effect,
                effect.joint,
                effect.parameters,
                effect.other_joint,
                f"{path}: effects.{k}",
                effect.native,
            )
            for k, effect in enumerate(planted.effects)
        )
        key, recordings = "base_parameters", planted.recordings
        return ExtendedModel(planted.base_parameters, effects, key, recordings)
    gap = GapResult.from_json(text, str(path))
    causes = tuple(
        SimulatedEffect(
            effect=cause.effect,
            joint=cause.joint,
            parameters={name: parameter.value for name, parameter in cause.parameters.items()},
            other_joint=cause.other_joint,
            source=f"{path}: causes.{k}",
        )
        for k, cause in enumerate(gap.causes)
    )
    parameters = {name: parameter.value for name, parameter in gap.extended_parameters.items()}
    return ExtendedModel(parameters, causes, "extended_parameters", gap.bags)
