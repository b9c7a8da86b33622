"""The extended model that a diagnosis wrote, read back to be simulated."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from idim_iv_ros.errors import UsageError
from idim_iv_ros.files import read_text
from idim_iv_ros.simulation import SimulatedEffect
from idim_iv_ros.simulation.effects import joint_effects

FORMAT = "idim_iv_ros/gap/1"


@dataclass(frozen=True)
class ExtendedModel:
    """Base parameters and effects of a `gap.json`.

    Attributes
    ----------
    source : Path
    parameters : dict of str to float
        Base parameters by name; those that the diagnosis does not know are left out.
    effects : tuple of SimulatedEffect
        Its causes, parametric ones too.
    """

    source: Path
    parameters: dict[str, float]
    effects: tuple[SimulatedEffect, ...]

    def known_parameters(self, names: Mapping[str, float]) -> dict[str, float]:
        """Return `parameters`, all of which must be among `names`.

        Raises
        ------
        UsageError
            A parameter that the robot does not have.
        """
        for name in self.parameters:
            if name not in names:
                raise UsageError(
                    f"{self.source}: extended_parameters.{name} is not a base parameter of this "
                    f"robot; they are {', '.join(names)}"
                )
        return self.parameters

    def known_effects(self, joints: Sequence[str]) -> tuple[SimulatedEffect, ...]:
        """Return `effects`, checked for a robot with these joints.

        Raises
        ------
        UsageError
            See `simulation.effects.joint_effects`; the message names file and cause.
        """
        joint_effects(self.effects, joints)
        return self.effects


def read_extended_model(path: Path) -> ExtendedModel:
    """Read base parameters and causes of a `gap.json`.

    Raises
    ------
    UsageError
        Not a file that a diagnosis wrote; the message names the file and the key.
    """
    text = read_text(path, "the diagnosis", megabytes=50.0)
    try:
        content = json.loads(text)
    except RecursionError as error:
        raise UsageError(f"{path}: not a diagnosis: nested too deep") from error
    except ValueError as error:
        raise UsageError(f"{path}: not JSON: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise UsageError(f"{path}: format is not {FORMAT}; a gap.json of `diagnose` is expected")
    causes = content.get("causes")
    if not isinstance(causes, list):
        raise UsageError(f"{path}: causes is not a list")
    return ExtendedModel(
        source=path,
        parameters=_values(content.get("extended_parameters"), f"{path}: extended_parameters"),
        effects=tuple(_effect(cause, f"{path}: causes[{k}]") for k, cause in enumerate(causes)),
    )


def _effect(cause: Any, source: str) -> SimulatedEffect:
    if not isinstance(cause, dict):
        raise UsageError(f"{source} is not a mapping")
    effect = cause.get("effect")
    if not isinstance(effect, str):
        raise UsageError(f"{source}.effect is not a name")
    for key in ("joint", "other_joint"):
        if not isinstance(cause.get(key), str | None):
            raise UsageError(f"{source}.{key} is not the name of a joint")
    return SimulatedEffect(
        effect=effect,
        joint=cause.get("joint"),
        parameters=_values(cause.get("parameters"), f"{source}.parameters"),
        other_joint=cause.get("other_joint"),
        source=source,
    )


def _values(group: Any, source: str) -> dict[str, float]:
    """Values of ``{name: {value, std, unit}}``."""
    if not isinstance(group, dict):
        raise UsageError(f"{source} is not a mapping of names to values")
    values = {}
    for name, entry in group.items():
        value = entry.get("value") if isinstance(entry, dict) else None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise UsageError(f"{source}.{name}.value is not a number")
        try:
            values[name] = float(value)
        except OverflowError:  # a whole number of more than 308 digits
            values[name] = math.inf
        if not math.isfinite(values[name]):
            raise UsageError(f"{source}.{name}.value is not a finite number")
    return values
