"""Prior probability of every option, and of an effect at a place against nothing more."""

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.candidate import Key, Kind, Scope
from idim_iv_ros.diagnosis.comparison.options import Options

_NOTHING = 0.5  # prior probability that there is nothing more
_SHAPES_OF_PRIOR = 5  # more shapes than these cost no presence


class Prior:
    """Prior probability of every option: of its effect, its place, its shape."""

    def __init__(self, options: Options) -> None:
        names: dict[tuple[str, Scope | None], list[int]] = {}
        for number, key in enumerate(options.keys):
            curve = options.is_curve[np.flatnonzero(options.key == number)[0]]
            name = "a free curve" if curve else key[0]
            names.setdefault((name, key[3]), []).append(number)
        weight = np.zeros(len(options.keys))
        for numbers in names.values():
            first = options.candidates[options.candidate[options.key == numbers[0]][0]]
            likely = (
                settings.PRIOR_OF_CURVE if first.kind is Kind.CURVE else first.effect.prior_weight
            )
            weight[numbers] = likely / len(numbers)
        weight *= (1.0 - _NOTHING) / weight.sum()
        shapes = np.bincount(options.key, minlength=len(options.keys))
        self.log = np.log(weight[options.key] / shapes[options.key])
        self.of_presence = self.log + np.log(np.minimum(shapes[options.key], _SHAPES_OF_PRIOR))
        self.nothing = float(np.log(_NOTHING))
        self._of_key = {
            options.keys[number]: float(value)
            for number, value in zip(options.key, self.of_presence, strict=True)
        }

    def odds_of_presence(self, key: Key) -> float:
        """Logarithm of the prior odds of an effect at a place against nothing more."""
        return self._of_key[key] - self.nothing
