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

    A mass is first, and always among them: it is what a payload is known by. All where no number
    is fitted.
    """
    ratios = {
        name: abs(parameter.value) / parameter.std
        for name, parameter in parameters.items()
        if parameter.std
    }
    ordered = sorted(ratios, key=lambda name: (name != "mass", -ratios[name]))
    chosen = ordered[:most] or list(parameters)
    shown = {name: parameter for name, parameter in parameters.items() if name in chosen}
    return {name: shown[name] for name in sorted(shown, key=lambda name: name != "mass")}
