"""Every effect at every joint, each with the shape that fits best."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.candidate import Candidate, rows_of
from idim_iv_ros.diagnosis.structural.likelihood import (
    Columns,
    Fit,
    Regression,
    white_noise_models,
)
from idim_iv_ros.diagnosis.structural.scan import Scan
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray

_STEPS = (0.3, 0.15, 0.07)


Grids = dict[tuple[str, Place, tuple[Shape, ...]], list[Columns]]


@dataclass(frozen=True)
class Search:
    """Search beside a model that is already fitted.

    Attributes
    ----------
    data : Baseline
    covered : OperatingRange
    regression : Regression
    fit : Fit
    grids : dict
        Rows of grids that were made before: the motion does not change.
    """

    data: Baseline
    covered: OperatingRange
    regression: Regression
    fit: Fit
    grids: Grids

    @cached_property
    def scan(self) -> Scan:
        """Score of candidates beside the model."""
        return Scan(self.regression, self.fit.noise_models, self.fit.residuals)

    def best(self, effect: Effect, place: Place) -> Candidate | None:
        """Return the candidate with its best shape, None where no shape is possible."""
        grid = effect.grid(place, self.covered)
        found = [self._best_of(effect, place, branch) for branch in effect.branches(grid) if branch]
        present = [candidate for candidate in found if candidate is not None]
        return max(present, key=lambda each: each.support, default=None)

    def _best_of(self, effect: Effect, place: Place, grid: Sequence[Shape]) -> Candidate | None:
        shape, score = self._scan(effect, place, grid, self._kept_rows(effect, place, grid))
        tried = len(grid)
        if shape is None:
            return None
        shape, score = self._refined(effect, place, shape, score)
        while True:
            further = effect.longer(shape, place, self.covered)
            if not further:
                break
            longer, terms = zip(*further, strict=True)
            tried += len(longer)
            rows = self._longer_rows(effect, place, shape, terms)
            more, higher = self._scan(effect, place, longer, rows)
            if more is None:
                break
            more, higher = self._refined(effect, place, more, higher)
            if higher - score < 2.0 * settings.LEAST_SUPPORT_OF_TERM:
                break
            shape, score = more, higher
        columns = rows_of(self.data, effect, place, [shape])[0]
        fitted = self._fitted(effect, place, shape, columns, tried)
        return None if fitted is None else fitted[0]

    def _fitted(
        self,
        effect: Effect,
        place: Place,
        shape: Shape,
        columns: Columns,
        tried: int,
        *,
        settle: bool = True,
    ) -> tuple[Candidate, Fit] | None:
        if not all(np.isfinite(rows).all() for rows in columns.values()):
            return None
        larger = self.regression.with_columns(columns)
        explained = self._explained(larger, place)
        # Most effects explain nothing: the noise is refined only where one may be accepted.
        may_be = explained >= settings.LEAST_SHARE_OF_EFFECT
        steps = settings.NOISE_MODEL_MORE_STEPS if may_be else 0
        fit = larger.fit(self.fit.noise_models, steps=steps)
        width = next(iter(columns.values())).shape[1]
        coefficients = fit.coefficients[-width:]
        if not effect.admissible(shape, coefficients):
            settled = effect.settled(shape, coefficients)
            if settled == shape or not settle:
                return None
            columns = rows_of(self.data, effect, place, [settled])[0]
            return self._fitted(effect, place, settled, columns, tried, settle=False)
        candidate = Candidate(
            effect,
            place,
            shape,
            columns,
            coefficients,
            {joint: fit.residuals[joint] for joint in place.joints},
            gain=larger.gain_of_last(fit),
            explained=explained,
            numbers=width + effect.free_numbers(shape),
            tried=tried,
        )
        return candidate, fit

    @cached_property
    def _white(self) -> tuple[AutoregressiveModel, ...]:
        return white_noise_models(self.regression.joints, self.fit.residuals)

    @cached_property
    def _gap(self) -> Fit:
        """Of least torque gap, without a candidate."""
        return self.regression.fit(self._white, steps=0)

    def _explained(self, larger: Regression, place: Place) -> float:
        """Mean over the joints of the effect."""
        after = larger.fit(self._white, steps=0).residuals
        joints = [place.joint] if place.other is None else [place.joint, place.other]
        left = [_energy(after[j]) / max(_energy(self._gap.residuals[j]), 1e-300) for j in joints]
        return 1.0 - float(np.mean(left))

    def _scan(
        self,
        effect: Effect,
        place: Place,
        shapes: Sequence[Shape],
        rows: Sequence[Columns],
    ) -> tuple[Shape | None, float]:
        """Shape with the highest score, and the score; `rows` are those of the shapes."""
        best: Shape | None = None
        highest = -1.0
        for shape, (score, coefficients) in zip(shapes, self.scan.scores(rows), strict=True):
            if score > highest and effect.admissible(shape, coefficients):
                best, highest = shape, score
        return best, highest

    def _kept_rows(self, effect: Effect, place: Place, shapes: Sequence[Shape]) -> list[Columns]:
        """Rows of a grid, made once for all searches."""
        key = (effect.name, place, tuple(shapes))
        if key not in self.grids:
            self.grids[key] = rows_of(self.data, effect, place, shapes)
        return self.grids[key]

    def again(self, candidate: Candidate) -> tuple[Candidate, Fit] | None:
        """Fit a candidate of another search, as it is, beside this model; with the fit."""
        return self._fitted(
            candidate.effect, candidate.place, candidate.shape, candidate.columns, candidate.tried
        )

    def _longer_rows(
        self, effect: Effect, place: Place, shape: Shape, terms: Sequence[Shape]
    ) -> list[Columns]:
        """Rows of a shape with each of the terms beside its own: theirs were made before."""
        own = rows_of(self.data, effect, place, [shape])[0]
        return [
            {joint: np.hstack([own[joint], term[joint]]) for joint in own}
            for term in self._kept_rows(effect, place, terms)
        ]

    def _refined(
        self, effect: Effect, place: Place, shape: Shape, score: float
    ) -> tuple[Shape, float]:
        for step in _STEPS:
            for _ in range(settings.SHAPE_CHANGES):
                near = effect.neighbours(shape, step, place, self.covered)
                if not near:
                    return shape, score
                rows = rows_of(self.data, effect, place, near)
                better, higher = self._scan(effect, place, near, rows)
                if better is None or higher <= score + settings.SHAPE_GAIN:
                    break
                shape, score = better, higher
        return shape, score


def _energy(residual: FloatArray) -> float:
    return float(np.vdot(residual, residual))
