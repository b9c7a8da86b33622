"""The probability that a selected term is a cause, calibrated on simulated recordings."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np
from scipy.special import expit

from idim_iv_ros.diagnosis.comparison.folds import Chosen
from idim_iv_ros.diagnosis.comparison.select import Selection
from idim_iv_ros.types import FloatArray

LEAST_GAIN = "least gain in the prediction of a part of the time, logarithm with its sign"
FEATURES = (
    "logarithm of what the objective loses without it",
    "share of the parts of the time without which it is chosen",
    LEAST_GAIN,
    "logarithm of its visible share of the torque over what remains beyond the noise",
    "its weight in its set",
    "logarithm of its visible share over that of all other effects at its joint",
    "logarithm of the variance of its score over that of the noise",
    "whether a free curve is left",
)
# What is lost counts in full up to the first; then only beside the dispersion of the scores, up to
# the second: few terms of the table lose more, and misfit alone makes dispersed scores.
_MOST_LOSS, _MOST_DISPERSED = 6.0, 12.0
_SMALL = 1e-3  # share of the torque
LIMITS = 0.01, 0.99  # no table of a few thousand recordings says more


@dataclass(frozen=True)
class Table:
    """Weights of a logistic regression."""

    origin: str  # from which recordings it was made
    terms: int  # of all of them
    intercept: float
    weights: dict[str, float]  # those of `FEATURES`
    effects: dict[str, float]  # added for an effect, drawn to zero: some look like misfit


@cache
def table() -> Table:
    """Return the table that ships with the package."""
    text = resources.files(__package__).joinpath("probability.json").read_text()
    return Table(**json.loads(text))


def features(
    selection: Selection, number: int, chosen: Chosen, remaining: FloatArray
) -> FloatArray:
    """What the probability of one term is computed from (see `FEATURES`).

    `chosen`: what the search does without parts of the time; `remaining`: (n_joints,) what all
    terms leave beyond the noise, as a share of the torque.
    """
    comparison, terms = selection.comparison, selection.terms
    term = terms[number]
    others = (*terms[:number], *terms[number + 1 :])
    loss = max(comparison.objective(terms) - comparison.objective(others), 0.0)
    dispersion = max(float(term.dispersion), 1.0)
    joint = int(np.argmax(term.visible))
    visible, beyond = float(term.visible[joint]), float(remaining[joint])
    least = float(np.min(chosen.gains[:, number]))
    # Shapes of effects are never exact: a small term beside large ones may be their misfit.
    rest = float(np.linalg.norm([other.visible[joint] for other in others if other.is_effect]))
    return np.array(
        [
            max(min(np.log1p(loss), _MOST_LOSS), min(np.log1p(loss / dispersion), _MOST_DISPERSED)),
            chosen.times(term) / len(chosen.keys),
            np.sign(least) * np.log1p(abs(least)),
            np.clip(np.log((visible + 0.1 * _SMALL) / (beyond + _SMALL)), -1.0, 2.0),
            dict(term.rivals).get(term.key, 0.0),
            min(np.log((visible + _SMALL) / (rest + _SMALL)), 2.0),
            np.log(term.dispersion),
            float(bool(selection.curves)),
        ]
    )


def probability(values: Sequence[float] | FloatArray, effect: str) -> float:
    """Probability of a term of an effect with these features."""
    weights = table()
    odds = weights.intercept + weights.effects.get(effect, 0.0)
    odds += float(np.dot([weights.weights[name] for name in FEATURES], values))
    return float(np.clip(expit(odds), *LIMITS))


def of_set(values: FloatArray, effect: str) -> float:
    """Probability that one of the set of a term is a cause: as if it had all of the weight."""
    whole = values.copy()
    whole[FEATURES.index("its weight in its set")] = 1.0
    return probability(whole, effect)
