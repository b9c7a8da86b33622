"""Causes in the diagnoses of several robots: those of the type, and those of single robots.

Robots have a cause in common where their values agree: in sign and, within their intervals, in
size. Robots of one type are never equal: sizes that differ by less than `_SCATTER` always agree.
"""

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence

import numpy as np
import scipy

from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.effects.registry import BY_NAME, parameter_words
from idim_iv_ros.fleet.result import BagResult, CauseSummary, CommonCause
from idim_iv_ros.fleet.statistics.random_effects import LEVEL, between_variance, generalised_q

# Share of the diagnosed ordinary robots in which a cause is one of the type, and the fewest robots.
_OF_TYPE, _OF_TYPE_LEAST = 2.0 / 3.0, 2
_OF_ROBOT = 0.5  # share of a robot's diagnosed bags in which a cause is one of the robot
_SCATTER = 0.5  # share of the larger size by which robots with one cause may differ
_INTERVAL = 1.96  # deviations, 95 %
_SHOWN = 2  # numbers of a cause in a sentence: those that differ from zero most surely


def is_nothing(cause: CauseSummary) -> bool:
    """Return whether no number of a cause is beyond no effect (95 %); False without deviations."""
    ratios = _ratios(cause).values()
    return bool(ratios) and max(ratios) <= _INTERVAL


def causes_of_robot(bags: Sequence[BagResult]) -> list[CauseSummary]:
    """Return the causes in most diagnosed bags, in the order of time, as the newest has them."""
    diagnosed = [bag.diagnosis for bag in bags if bag.diagnosis is not None]
    named: dict[tuple[str, str | None], list[CauseSummary]] = defaultdict(list)
    for diagnosis in diagnosed:
        for key, cause in {(c.effect, c.joint): c for c in diagnosis.causes}.items():
            named[key].append(cause)
    return [causes[-1] for causes in named.values() if len(causes) > _OF_ROBOT * len(diagnosed)]


def common_causes(
    causes: Mapping[str, Sequence[CauseSummary]], ordinary: Collection[str]
) -> tuple[CommonCause, ...]:
    """Group the causes of diagnosed robots into those of the type and those of single robots.

    Another size of an effect at a joint is another cause. The `ordinary` robots are as their type.
    """
    places: dict[tuple[str, str | None], dict[str, CauseSummary]] = defaultdict(dict)
    for robot, named in causes.items():
        for cause in named:
            places[cause.effect, cause.joint][robot] = cause
    result = []
    for (effect, joint), robots in places.items():
        while robots:
            # A group begins with the robot with which most of the ordinary robots agree.
            agreeing = [
                [name for name, other in robots.items() if _sizes_agree(first, other)]
                for first in robots.values()
            ]
            names = max(agreeing, key=lambda names: (len({*names} & {*ordinary}), len(names)))
            group = [robots.pop(name) for name in names]
            among = len({*names} & {*ordinary})
            of_type = among >= max(_OF_TYPE_LEAST, _OF_TYPE * len({*ordinary}))
            values = _mean_parameters(group)
            result.append(CommonCause(effect, group[0].kind, joint, tuple(names), of_type, values))
    result.sort(key=lambda c: (not c.of_type, -len(c.robots), c.effect, c.joint or ""))
    return tuple(result)


def sentences(
    type_name: str,
    causes: Sequence[CommonCause],
    diagnosed: Collection[str],
    ordinary: Collection[str],
) -> tuple[str, ...]:
    """Return sentences on the common and single causes of a type; empty without a diagnosis."""
    if not diagnosed:
        return ()
    said = []
    count = len(set(ordinary))
    shared = {(cause.effect, cause.joint): cause for cause in causes if cause.of_type}
    for cause in shared.values():
        among = len(set(cause.robots) & set(ordinary))
        said.append(
            f"{type_name}: the nominal model misses {_words(cause)} on {among} of "
            f"{count} ordinary robots that were diagnosed: a matter of the type"
        )
    if not shared and count >= _OF_TYPE_LEAST:
        robots = f"{count} ordinary robots that were diagnosed"
        said.append(f"{type_name}: no cause is common to the {robots}")
    for cause in causes:
        if cause.of_type:
            continue
        place = (cause.effect, cause.joint)
        several = sum((other.effect, other.joint) == place for other in causes) > 1
        single = len(cause.robots) == 1
        alone = " alone" if single and not several and len(diagnosed) > 1 else ""
        words = f"{', '.join(cause.robots)}{alone} {'has' if single else 'have'} {_words(cause)}"
        usual = shared.get(place)
        said.append(f"{words}, apart from that of {type_name}{_size(usual)}" if usual else words)
    return tuple(said)


def _sizes_agree(one: CauseSummary, other: CauseSummary) -> bool:
    """Return whether two causes may be equal: their common numbers agree in sign and size.

    Intervals hold for all numbers together, 95 % (Bonferroni).
    """
    first, second = _with_std(one), _with_std(other)
    same = first.keys() & second.keys()
    if (first or second) and not same:
        return False  # nothing to compare
    for name in one.parameters.keys() & other.parameters.keys() - same:
        spec = BY_NAME[one.effect].spec(name) if one.effect in BY_NAME else None
        signs = one.parameters[name].value, other.parameters[name].value
        if spec is not None and spec.bound == "1 or -1" and signs[0] != signs[1]:
            return False
    deviations = scipy.stats.norm.isf(0.5 * (1.0 - LEVEL) / max(len(same), 1))
    for name in same:
        without = _without_effect(one.effect, name)
        values = np.array([first[name].value, second[name].value]) - without
        noise = np.hypot(first[name].std or 0.0, second[name].std or 0.0)
        if abs(values[0] - values[1]) > max(deviations * noise, _SCATTER * np.abs(values).max()):
            return False
    return True


def _mean_parameters(causes: Sequence[CauseSummary]) -> dict[str, EffectParameter]:
    """Return the mean of each number that half of the robots determine, scatter in its σ."""
    numbers = {}
    for name in dict.fromkeys(name for cause in causes for name in _with_std(cause)):
        same = [cause.parameters[name] for cause in causes if name in _with_std(cause)]
        if 2 * len(same) < len(causes):
            continue
        values, stds = np.array([[number.value, number.std] for number in same]).T[:, :, None]
        _, mean, variance = generalised_q(values, stds**2, between_variance(values, stds**2))
        numbers[name] = EffectParameter(float(mean[0]), float(np.sqrt(variance[0])), same[0].unit)
    return numbers


def _with_std(cause: CauseSummary | CommonCause) -> dict[str, EffectParameter]:
    return {name: number for name, number in cause.parameters.items() if number.std is not None}


def _without_effect(effect: str, name: str) -> float:
    """Return the value of a parameter at which an effect vanishes: one of a gain, else zero."""
    cause = BY_NAME.get(effect)
    spec = cause.spec(name) if cause is not None and cause.kind == "parametric" else None
    default = spec.default if spec is not None else None
    return default if default is not None and np.isfinite(default) else 0.0


def _ratios(cause: CauseSummary | CommonCause) -> dict[str, float]:
    """Return the distances of numbers from their values without effect, in deviations."""
    ratios = {}
    for name, number in _with_std(cause).items():
        distance = abs(number.value - _without_effect(cause.effect, name))
        ratios[name] = distance / number.std if number.std else np.inf if distance else 0.0
    return ratios


def _words(cause: CommonCause) -> str:
    name = cause.effect.replace("_dependent", "-dependent").replace("_", " ")
    place = f" at {cause.joint}" if cause.joint else ""
    return f"{name}{place}{_size(cause)}"


def _size(cause: CommonCause) -> str:
    """Return the best determined numbers of a cause with their 95 % intervals, in brackets."""
    ratios, said = _ratios(cause), []
    for name in sorted(ratios, key=lambda name: -ratios[name])[:_SHOWN]:
        number = cause.parameters[name]
        interval = f"{number.value:.2g} ± {_INTERVAL * (number.std or 0.0):.1g}"
        said.append(f"{parameter_words(cause.effect, name)} {interval} {number.unit}".rstrip())
    return f" ({', '.join(said)})" if said else ""
