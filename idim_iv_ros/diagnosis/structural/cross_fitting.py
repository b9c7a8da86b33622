"""Selection as part of the fold: effects, joints, shapes and sizes chosen without the data that
judge them.

A search that looks at all data and is tested on parts of them has seen the answers. Here the whole
choice is made again without each fold, and the fold is predicted with what was chosen then.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.held_out.held_out import HeldOut, folds_of, interleaved_folds
from idim_iv_ros.diagnosis.held_out.time_blocks import time_blocks
from idim_iv_ros.diagnosis.parametric.errors_beyond_base import ErrorBeyondBase
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.noise_floor import NoiseFloor, Repeat
from idim_iv_ros.diagnosis.structural.attribution import Attribution, Found
from idim_iv_ros.diagnosis.structural.calibration import (
    largest_support,
    null_noise,
    null_supports,
    p_value,
)
from idim_iv_ros.diagnosis.structural.candidate import Candidate, operating_range
from idim_iv_ros.diagnosis.structural.confidence import with_sets
from idim_iv_ros.diagnosis.structural.fold_model import FoldModel
from idim_iv_ros.diagnosis.structural.fold_products import FoldProducts
from idim_iv_ros.diagnosis.structural.fold_search import FoldCandidate, FoldSearch, block_key
from idim_iv_ros.diagnosis.structural.likelihood import white_noise_models
from idim_iv_ros.diagnosis.structural.menu import menu_of
from idim_iv_ros.diagnosis.structural.nonparametric import Nonparametric
from idim_iv_ros.types import FloatArray, IntArray


@dataclass(frozen=True)
class Chosen:
    """In how many folds a cause was chosen.

    Attributes
    ----------
    own : int
        The cause itself.
    standing_in : int
        The cause, or what is indistinguishable from it.
    folds : int
    """

    own: int
    standing_in: int
    folds: int

    @property
    def words(self) -> str:
        """Such as ``5 of 5``."""
        return f"{self.own} of {self.folds}"


@dataclass(frozen=True, eq=False)
class CrossFit:
    """What is chosen without each fold.

    Attributes
    ----------
    data : Baseline
    folds : one (r_j,) int array for each joint
        −1 for rows that belong to none.
    note : str
        How the data were divided.
    search : FoldSearch
    chosen : for each fold the candidates, in the order in which they were accepted
    """

    data: Baseline
    folds: tuple[IntArray, ...]
    note: str
    search: FoldSearch
    chosen: tuple[tuple[FoldCandidate, ...], ...]

    def times(self, found: Found, others: Sequence[Found]) -> Chosen:
        """In how many folds an effect is chosen; `others`: the causes beside it."""
        own = sum(any(each.key == found.candidate.key for each in fold) for fold in self.chosen)
        standing = sum(self._standing_in(found, others, fold) is not None for fold in self.chosen)
        return Chosen(own, standing, len(self.chosen))

    @property
    def chosen_of_all(self) -> Counter[tuple[str, int, int | None]]:
        """In how many folds each effect and place is chosen."""
        return Counter(each.key for fold in self.chosen for each in fold)

    def _standing_in(
        self, found: Found, others: Sequence[Found], chosen: Sequence[FoldCandidate]
    ) -> FoldCandidate | None:
        """The fold's own version of an effect, or what is indistinguishable from it."""
        for each in chosen:
            if each.key == found.candidate.key:
                return each
        others_in_set = {other.key for other, _ in found.indistinguishable_from}
        others_in_set -= {other.candidate.key for other in others}
        return next((each for each in chosen if each.key in others_in_set), None)

    def held_out(
        self,
        found: Sequence[Found],
        labels: Sequence[str],
        floors: Sequence[NoiseFloor],
        given: FloatArray | None,
    ) -> HeldOut:
        """Predict every fold by the refit and with one effect after the other.

        Each with the shape and the coefficients that it has without the fold; where it is not
        chosen without the fold, it adds nothing there.

        Parameters
        ----------
        found
            Accepted effects, in their order.
        labels
            Names of their stages.
        given
            (b,) of the nominal model; None where there is none.
        """
        data, products = self.data, self.search.plain
        plain = [[table[:, -1].copy() for table in products.white] for _ in range(len(found) + 1)]
        white = [
            [table[:, -1].copy() for table in self.search.white.white]
            for _ in range(len(found) + 1)
        ]
        for fold, chosen in enumerate(self.chosen):
            model = self.search.model(fold)
            for stage in range(len(found) + 1):
                if stage:
                    one = self._standing_in(found[stage - 1], found, chosen)
                    model = model if one is None else model.beside(one)
                _predict(model.plain, plain[stage], fold)
                _predict(model.white, white[stage], fold)
        scales = [noise.sigma for noise in products.noise_models]
        stages = [
            tuple(rest * scale for rest, scale in zip(stage, scales, strict=True))
            for stage in plain
        ]
        if given is not None:
            stages.insert(0, tuple(rows.residual(given) for rows in products.joints))
        return HeldOut(
            joints=data.joints,
            names=(*([] if given is None else ["given"]), "refit", *labels),
            folds=self.folds,
            blocks=tuple(
                time_blocks(recording, place, data.row_rate)
                for recording, place in zip(data.recordings, data.places, strict=True)
            ),
            residuals=tuple(stages),
            whitened=tuple(tuple(stage) for stage in white),
            own_joints=tuple(tuple(sorted(each.candidate.columns)) for each in found),
            floors=tuple(floors),
            note=self.note,
        )


def _predict(model: FoldModel, residuals: Sequence[FloatArray], fold: int) -> None:
    """Put the weighted residuals that a model without a fold leaves there."""
    products = model.products
    blocks = [products.block(each.key, {}) for each in model.accepted]
    for joint, values in enumerate(model.theta):
        inside = products.folds[joint] == fold
        residuals[joint][inside] = products.rest(joint, inside, blocks, values[:, None])[:, 0]


class CrossFitting:
    """Choices without folds of an attribution, made when they are first asked for.

    Parameters
    ----------
    repeats
        Recordings that repeat one another are held out together.
    """

    def __init__(
        self, data: Baseline, attribution: Attribution, repeats: Sequence[Repeat] = ()
    ) -> None:
        self.data, self.attribution, self.repeats = data, attribution, tuple(repeats)
        self.covered = operating_range(data)
        self.menu = menu_of(attribution.catalogue, self.covered, attribution.grids)

    def choices(self, *, interleaved: bool) -> CrossFit:
        """Choose without each fold; `interleaved` where an effect changes with time."""
        return self._interleaved if interleaved else self._apart

    def p_value(self, found: Found, others: Sequence[Found]) -> tuple[float | None, str]:
        """Chance that the best of all candidates does as well as one effect beside the others.

        And what it was computed from, in words; or None and why not. See `calibration`.
        """
        drifts = any(each.candidate.effect.family == "time" for each in (found, *others))
        products = self.choices(interleaved=drifts).search.white
        model = FoldModel(products)
        for each in others:
            key = block_key(each.candidate)
            model = model.beside(key, products.block(key, each.candidate.columns))
        observed = largest_support(model, found.candidate.key)
        if not np.isfinite(observed):
            return None, "none: no shape of the effect's grid is possible beside the other causes"
        draws = int(settings.NULL_DRAWS)
        return p_value(observed, null_supports(model)), (
            f"largest support in {draws} recordings simulated without the effect, with the noise "
            f"of the fit; it cannot be below {1.0 / (draws + 1.0):.2g}"
        )

    def with_sets(self, found: Sequence[Found]) -> tuple[Found, ...]:
        """Accepted effects, each with what is indistinguishable from it beside the others.

        Of a set, the effect is named that most folds choose.
        """
        if not found:
            return ()
        drifts = any(each.candidate.effect.family == "time" for each in found)
        crossed = self.choices(interleaved=drifts)
        sets = with_sets(self.data, crossed.search, found)
        named = tuple(self._most_chosen(each, sets, crossed) for each in sets)
        if all(one is other for one, other in zip(named, sets, strict=True)):
            return sets
        return with_sets(self.data, crossed.search, named)

    def _most_chosen(self, this: Found, found: Sequence[Found], crossed: CrossFit) -> Found:
        """What most folds choose of an effect and what is indistinguishable from it."""
        taken = {each.candidate.key for each in found}
        times = crossed.chosen_of_all
        best, most = None, times[this.candidate.key]
        for other, _ in this.indistinguishable_from:
            named = not isinstance(other.effect, Nonparametric | ErrorBeyondBase)
            if named and other.key not in taken and times[other.key] > most:
                best, most = other, times[other.key]
        if best is None:
            return this
        regression = self.attribution.regression
        for each in found:
            if each is not this:
                regression = regression.with_columns(each.candidate.columns)
        noise = self.attribution.fit.noise_models
        larger = regression.with_columns(best.columns)
        fit = larger.fit(noise, steps=settings.NOISE_MODEL_MORE_STEPS)
        candidate = Candidate(
            best.effect,
            best.place,
            best.shape,
            best.columns,
            fit.coefficients[-len(best.coefficients) :],
            {joint: fit.residuals[joint] for joint in best.place.joints},
            larger.gain_of_last(fit),
            best.explained,
            best.numbers,
            best.tried,
        )
        return Found(candidate, alternatives=(this.candidate, *this.alternatives))

    @cached_property
    def _apart(self) -> CrossFit:
        return self._made(*folds_of(self.data, self.repeats))

    @cached_property
    def _interleaved(self) -> CrossFit:
        return self._made(*interleaved_folds(self.data))

    def _made(self, folds: tuple[IntArray, ...], note: str) -> CrossFit:
        found = self.attribution
        regression, values = found.regression, found.refit.values
        gap = white_noise_models(regression.joints, found.fit.residuals)
        noise = null_noise(regression, found.fit.noise_models, folds)
        white = FoldProducts(regression, found.fit.noise_models, values, folds, self.menu, noise)
        plain = FoldProducts(regression, gap, values, folds, self.menu)
        search = FoldSearch(self.data, self.covered, white, plain)
        chosen = tuple(search.chosen(fold) for fold in range(white.count))
        return CrossFit(self.data, folds, note, search, chosen)
