"""What the numbers of a cause are, in words: by effect and name in gap.json."""

from collections.abc import Mapping

from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import BY_NAME


def parameter_words(effect: str, name: str) -> str:
    """Return what a number of a cause is; its name without underscores where that says it."""
    cause = BY_NAME.get(effect)
    return name.replace("_", " ") if cause is None else cause.parameter_words(name)


def surest(parameters: Mapping[str, EffectParameter], most: int) -> dict[str, EffectParameter]:
    """Return at most so many numbers, in their order: those that differ from zero most surely.

    All where no number is fitted.
    """
    ratios = {name: abs(each.value) / each.std for name, each in parameters.items() if each.std}
    chosen = sorted(ratios, key=lambda name: -ratios[name])[:most] or list(parameters)
    return {name: each for name, each in parameters.items() if name in chosen}
