"""What changed in a series of estimates, when, and by how much: no change, a step, or a ramp.

y_k = μ + δ s_k(c) + e_k with s a step from place c on, or a ramp that begins at the one before, and
e_k independent with variances proportional to those given: estimates of recordings, in the order of
time, with what recordings of an unchanged robot differ by included. The factor φ of proportion is
estimated, so that a robot which scatters more than its variances say is not called changed. What
is known of φ beforehand, from other robots, counts as so many degrees of freedom: ν/φ follows χ²
with ν of them (Smyth, Stat. Appl. Genet. Mol. Biol. 3, 2004).

The place is searched, so the largest F of all places is judged by its own distribution under no
change: simulated, and where it lies beyond what simulation resolves, bounded by the sum over places
(Bonferroni).
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal

import numpy as np
import scipy

from idim_iv_ros.types import FloatArray, IntArray

Kind = Literal["step", "ramp"]

LEAST = 5  # values below which nothing is judged
_SIDE_VALUES = 2  # values on each side of a step, and on a ramp: one odd value is no change
_MOST_PLACES = 150  # more are thinned evenly
_DRAWS: Final = 9999
_FIRST_DRAWS: Final = 999  # that suffice where the change is no surprise
_NO_SURPRISE = 20  # of these draws with a larger one
_WORTH_DRAWING = 0.1  # the p-value of the best place alone above which the bound suffices
_SEED = 1
# 95 % of the likelihood ratio at the place of a step (Hansen, Econometrica 68, 2000, table I); a
# ramp's begin is an ordinary parameter, χ² with one degree of freedom.
_LARGEST_RATIO = {"step": 7.35, "ramp": 3.84}
_LEVEL = 0.95


@dataclass(frozen=True)
class Change:
    """The best supported change of a series, believed or not.

    `p_value`: of the null hypothesis that nothing changed, the search over kinds and places
    included. `place`: first value that is changed, from 0. `place_low`, `place_high`: 95 % interval
    of `place`. `before`, `before_std`: level before the change. `size`, `size_low`, `size_high`:
    change at the last value, with an interval that holds it for every place in question.
    """

    kind: Kind
    p_value: float
    place: int
    place_low: int
    place_high: int
    before: float
    before_std: float
    size: float
    size_low: float
    size_high: float
    fitted: FloatArray


def change_of(
    values: FloatArray, variances: FloatArray, times: FloatArray, prior: float = 0.0
) -> Change | None:
    """Search a series for a change.

    - `values`, `variances`: (k,), variances matter up to a common factor where `prior` is zero
    - `times`: (k,), not decreasing
    - `prior`: ν: degrees of freedom by which the variances are known already

    Returns None where there are fewer than five values, all are equal, or all are of one time.
    """
    count = len(values)
    if count < LEAST:
        return None
    roots = 1.0 / np.sqrt(variances)
    if prior == 0.0:
        # A common factor of the variances cancels; without it numbers stay near one.
        roots = roots / np.sqrt(np.mean(roots**2))
    mean = roots / np.linalg.norm(roots)
    kinds, places, shapes = _candidates(times)
    whole = float(times[-1] - times[0])
    if not len(shapes) or whole <= 0.0:
        return None
    directions = roots * shapes
    directions = directions - np.outer(directions @ mean, mean)
    norms = np.linalg.norm(directions, axis=1)
    directions = directions / norms[:, None]
    target = roots * (values - np.mean(values))
    target = target - (target @ mean) * mean
    energy = float(target @ target)
    if energy <= 1e-28 * float(np.sum((roots * values) ** 2)) + 1e-300:
        return None
    along = directions @ target
    gains = along**2
    best = int(np.argmax(gains))
    kind, dof = kinds[best], count - 2 + prior
    rests = np.maximum(energy - gains, 0.0) + prior
    possible = np.flatnonzero(
        (np.array(kinds) == kind)
        & (rests - rests[best] <= _LARGEST_RATIO[kind] * rests[best] / dof + 1e-12 * energy)
    )
    sizes = along / norms
    half = float(scipy.stats.t.isf(0.5 * (1.0 - _LEVEL), dof)) * np.sqrt(rests / dof) / norms
    # Level of the series without its change, and its deviation with the change free.
    total, shape = float(np.sum(roots**2)), shapes[best]
    weights = roots**2 / total
    first, second = float(weights @ shape), float(weights @ shape**2)
    before = float(weights @ (values - sizes[best] * shape))
    before_std = float(np.sqrt(second / (second - first**2) / total))
    before_std *= float(np.sqrt(rests[best] / dof))
    return Change(
        kind=kind,
        p_value=_p_value(float(gains[best]) / (energy + prior), directions, mean, prior),
        place=int(places[best]),
        place_low=int(places[possible].min()),
        place_high=int(places[possible].max()),
        before=before,
        before_std=before_std,
        size=float(sizes[best]),
        size_low=float(np.min(sizes[possible] - half[possible])),
        size_high=float(np.max(sizes[possible] + half[possible])),
        fitted=before + sizes[best] * shape,
    )


def _candidates(times: FloatArray) -> tuple[list[Kind], IntArray, FloatArray]:
    """Kind, first changed value and shape (c, k) of each candidate.

    Nothing begins between values of the same time: their order means nothing.
    """
    count = len(times)
    begins = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0.0)
    begins = begins[(begins >= 1) & (begins <= count - _SIDE_VALUES)]
    steps, ramps = (
        places[:: max(-(-len(places) // _MOST_PLACES), 1)]
        for places in (begins[begins >= _SIDE_VALUES], begins)
    )
    index = np.arange(count)
    shapes = [(index >= place).astype(float) for place in steps]
    shapes += [np.maximum(times - times[place - 1], 0.0) for place in ramps]
    shapes = [shape / max(float(shape[-1]), 1e-300) for shape in shapes]
    kinds: list[Kind] = [*(["step"] * len(steps)), *(["ramp"] * len(ramps))]  # type: ignore[list-item]
    return kinds, np.concatenate([steps, ramps]), np.array(shapes)


@lru_cache(maxsize=16)
def _draws(count: int, prior: float) -> tuple[FloatArray, FloatArray]:
    """Series without a change for φ = 1 (d, k), and ν / φ of what was known beforehand (d,)."""
    random = np.random.default_rng([_SEED, count])
    drawn = random.standard_normal((_DRAWS, count))
    return drawn, random.chisquare(prior, _DRAWS) if prior > 0.0 else np.zeros(_DRAWS)


def _p_value(ratio: float, directions: FloatArray, mean: FloatArray, prior: float) -> float:
    """Probability of so large a share of the energy in one of the directions."""
    dof = len(mean) - 2 + prior
    if ratio >= 1.0:
        return 0.0
    single = float(scipy.stats.f.sf(ratio / (1.0 - ratio) * dof, 1, dof))
    bound = min(1.0, single * len(directions))
    if single > _WORTH_DRAWING:
        return bound
    for count in (_FIRST_DRAWS, _DRAWS):
        drawn, scatter = (of[:count] for of in _draws(len(mean), prior))
        energy = np.sum(drawn**2, axis=1) - (drawn @ mean) ** 2 + scatter
        largest = np.max((drawn @ directions.T) ** 2, axis=1)
        exceeding = int(np.sum(largest >= ratio * energy))
        if exceeding >= _NO_SURPRISE:
            break
    return min(bound, (1.0 + exceeding) / (count + 1.0))
