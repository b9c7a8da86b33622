"""The search without one fold: which effects, at which joints, of which shape and size.

The rules are those of `attribution`; only the noise models are those of the final fit. A score
needs no fit but the algebra of `fold_model`. Shapes beside the grid are made once for all folds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.structural.candidate import rows_of
from idim_iv_ros.diagnosis.structural.fold_model import FoldModel, View
from idim_iv_ros.diagnosis.structural.fold_products import Block, FoldProducts
from idim_iv_ros.diagnosis.structural.likelihood import Columns
from idim_iv_ros.diagnosis.structural.menu import Entry
from idim_iv_ros.diagnosis.structural.rules import (
    Judged,
    acceptable,
    own_cause,
    preferred,
    with_most_of_gap,
)
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape
from idim_iv_ros.types import FloatArray

_STEPS = (0.3, 0.15, 0.07)  # of a shape's refinement, as in the search
_REFINED = 3  # candidates whose shape is refined before one of them is taken
_NEARLY = 3.0  # ln likelihood that the refinement of a shape may still bring

BlockKey = tuple[str, Place, Shape]


@dataclass(frozen=True, eq=False)
class FoldCandidate:
    """An effect at a place with its best shape without one fold; as `Candidate`.

    Attributes
    ----------
    effect, place, shape, columns, gain, explained, numbers, tried
        See `Candidate`.
    rows : int
        Fitted rows of the joints of its place.
    coefficients : (w,)
    """

    effect: Effect
    place: Place
    shape: Shape
    columns: Columns
    gain: float
    explained: float
    numbers: int
    tried: int
    rows: int
    coefficients: FloatArray

    @property
    def support(self) -> float:
        """Gain less the cost of numbers and search (Schwarz)."""
        return self.gain - cost(self.numbers, self.rows, self.tried)

    @property
    def key(self) -> tuple[str, int, int | None]:
        """Effect and place."""
        return self.effect.name, self.place.joint, self.place.other


def block_key(candidate: Judged) -> BlockKey:
    """Key of a candidate's columns."""
    return candidate.effect.name, candidate.place, candidate.shape


def cost(numbers: int, rows: int, tried: int) -> float:
    """What chance would gain with so many numbers and shapes, and more: ln likelihood."""
    return 0.5 * numbers * float(np.log(max(rows, 2))) + float(np.log(tried))


def own_joints(place: Place) -> list[int]:
    """The joint of a place, or both of a coupling."""
    return [place.joint] if place.other is None else [place.joint, place.other]


@dataclass(frozen=True, eq=False)
class Both:
    """One model with two weights: of the likelihood, and of the least torque gap."""

    white: FoldModel
    plain: FoldModel

    def beside(self, candidate: Judged) -> "Both":
        """Return the same with one candidate more."""
        key, columns = block_key(candidate), candidate.columns
        return Both(
            self.white.beside(key, self.white.products.block(key, columns)),
            self.plain.beside(key, self.plain.products.block(key, columns)),
        )


class FoldSearch:
    """What a search needs of every fold.

    Parameters
    ----------
    white, plain
        Products with the noise models of the final fit, and with white ones.
    """

    def __init__(
        self, data: Baseline, covered: OperatingRange, white: FoldProducts, plain: FoldProducts
    ) -> None:
        self.data, self.covered = data, covered
        self.white, self.plain = white, plain
        self.menu = white.menu
        self._rows: dict[BlockKey, Columns] = {
            (entry.effect.name, entry.place, shape): rows
            for entry in self.menu.entries
            for shape, rows in zip(entry.shapes, entry.rows, strict=True)
        }

    def model(self, left_out: int) -> Both:
        """Without effects."""
        return Both(FoldModel(self.white, left_out), FoldModel(self.plain, left_out))

    def chosen(self, left_out: int) -> tuple[FoldCandidate, ...]:
        """Accept the best candidate beside those before it, until none is acceptable."""
        base = current = self.model(left_out)
        found: list[FoldCandidate] = []
        for _ in range(settings.MOST_EFFECTS + len(self.data.joints)):
            if len(found) >= settings.MOST_EFFECTS:
                break
            candidates = self.candidates(current, {each.key for each in found})
            best = preferred(with_most_of_gap([c for c in candidates if own_cause(c, found)]))
            if best is None or not acceptable(best):
                break
            found.append(best)
            current = current.beside(best)
            if len(found) > 1:
                found = self._revised(base, found, candidates)
                current = _with(base, found)
        return tuple(found)

    def _revised(
        self, base: Both, found: Sequence[FoldCandidate], tried: Sequence[FoldCandidate]
    ) -> list[FoldCandidate]:
        """Look at each effect again beside the others, as `attribution` does."""
        newest, kept = found[-1], list(found)
        for this in found:
            if this is not newest and not set(this.columns) & set(newest.columns):
                continue
            others = [each for each in kept if each is not this]
            options = {this.key}
            options |= {(name, *this.key[1:]) for name in this.effect.confounders}
            least = this.support - settings.INDISTINGUISHABLE_SUPPORT
            options |= {each.key for each in tried if each.support >= least}
            options -= {each.key for each in others}
            again = self.candidates(_with(base, others), {each.key for each in others}, options)
            best = preferred(with_most_of_gap(again))
            place = next(k for k, each in enumerate(kept) if each is this)
            if best is None or not acceptable(best):
                del kept[place]
            else:
                kept[place] = best
        return kept

    def candidates(
        self,
        model: Both,
        taken: set[tuple[str, int, int | None]],
        only: set[tuple[str, int, int | None]] | None = None,
        refined: int | None = None,
    ) -> list[FoldCandidate]:
        """Candidates worth a fit, one for each effect and place; the best with a refined shape.

        Parameters
        ----------
        taken
            Keys of effects that the model has.
        only
            Keys that are asked for; None: all.
        refined
            How many shapes are refined, the best supported first; None: those of the few that may
            be accepted.
        """
        rough = []
        for entry, shape, place, score in self.best_shapes(model.white):
            key = (entry.effect.name, entry.place.joint, entry.place.other)
            if key in taken or (only is not None and key not in only):
                continue
            least = self._least_support(entry, shape, model.white.weights) - _NEARLY
            if 0.5 * score >= least:
                rough.append(
                    (
                        entry,
                        shape,
                        model.white.view_of_menu(place, entry.width),
                        model.plain.view_of_menu(place, entry.width),
                    )
                )
        found = self._fitted(model, rough)
        hot = with_most_of_gap(found) if refined is None else list(found)
        hot = sorted(filter(self._can_move, hot), key=lambda each: -each.support)
        for each in hot[: _REFINED if refined is None else refined]:
            found[next(k for k, c in enumerate(found) if c is each)] = self._refined(model, each)
        best: dict[tuple[str, int, int | None], FoldCandidate] = {}
        for each in found:
            if each.key not in best or each.support > best[each.key].support:
                best[each.key] = each
        return list(best.values())

    def _can_move(self, each: FoldCandidate) -> bool:
        return bool(each.effect.neighbours(each.shape, _STEPS[0], each.place, self.covered))

    def best_shapes(self, model: FoldModel) -> list[tuple[Entry, Shape, int, float]]:
        """Best admissible shape of each entry, its first column in the menu, and its score."""
        scores = model.scores()
        at = dict.fromkeys(scores, 0)
        found = []
        for entry in self.menu.entries:
            start = at[entry.width]
            part = slice(start, start + len(entry.shapes))
            at[entry.width] = part.stop
            values, coefficients = (each[part] for each in scores[entry.width])
            for k in np.argsort(-values, kind="stable"):
                if values[k] <= 0.0:
                    break
                if entry.effect.admissible(entry.shapes[k], coefficients[k]):
                    first = entry.columns.start + int(k) * entry.width
                    found.append((entry, entry.shapes[k], first, float(values[k])))
                    break
        return found

    def _least_support(self, entry: Entry, shape: Shape, weights: FloatArray) -> float:
        rows = self._row_count(entry.place, weights)
        return settings.LEAST_SUPPORT + cost(entry.numbers(shape), rows, entry.tried)

    def _row_count(self, place: Place, weights: FloatArray) -> int:
        return int(sum(self.white.rows[joint] @ weights for joint in own_joints(place)))

    def _fitted(
        self, model: Both, rough: Sequence[tuple[Entry, Shape, View, View]]
    ) -> list[FoldCandidate]:
        """Candidates of the grid with their gains."""
        coefficients, energies = model.white.with_candidates([each[2] for each in rough])
        _, gaps = model.plain.with_candidates([each[3] for each in rough])
        before, gap = model.white.energies(), model.plain.energies()
        rows = self.white.rows @ model.white.weights
        made = []
        for (entry, shape, _, _), own, after, gap_after in zip(
            rough, coefficients, energies, gaps, strict=True
        ):
            joints = own_joints(entry.place)
            made.append(
                FoldCandidate(
                    entry.effect,
                    entry.place,
                    shape,
                    self._columns(entry.effect, entry.place, [shape])[0],
                    gain=float(0.5 * rows @ np.log(before / after)),
                    explained=float(np.mean(1.0 - gap_after[joints] / gap[joints])),
                    numbers=len(own) + entry.effect.free_numbers(shape),
                    tried=entry.tried,
                    rows=self._row_count(entry.place, model.white.weights),
                    coefficients=own,
                )
            )
        return made

    def _refined(self, model: Both, candidate: FoldCandidate) -> FoldCandidate:
        """Move the shape in small steps, and add terms, as the search does."""
        effect, place, shape = candidate.effect, candidate.place, candidate.shape
        tried = candidate.tried
        _, score = self._best_of(model.white, effect, place, [shape])
        shape, score = self._moved(model.white, effect, place, shape, score)
        while further := effect.longer(shape, place, self.covered):
            tried += len(further)
            own = self._columns(effect, place, [shape])[0]
            terms = self._columns(effect, place, [term for _, term in further])
            for (longer, _), term in zip(further, terms, strict=True):
                rows = {joint: np.hstack([own[joint], term[joint]]) for joint in own}
                self._rows.setdefault((effect.name, place, longer), rows)
            more, higher = self._best_of(model.white, effect, place, [long for long, _ in further])
            if more is None:
                break
            more, higher = self._moved(model.white, effect, place, more, higher)
            if higher - score < 2.0 * settings.LEAST_SUPPORT_OF_TERM:
                break
            shape, score = more, higher
        entry = Entry(effect, place, (shape,), self._columns(effect, place, [shape]), 0, tried)
        views = [
            each.view(self._block(each.products, effect, place, shape))
            for each in (model.white, model.plain)
        ]
        (found,) = self._fitted(model, [(entry, shape, views[0], views[1])])
        return found if found.support >= candidate.support else candidate

    def _moved(
        self, model: FoldModel, effect: Effect, place: Place, shape: Shape, score: float
    ) -> tuple[Shape, float]:
        for step in _STEPS:
            for _ in range(settings.SHAPE_CHANGES):
                near = effect.neighbours(shape, step, place, self.covered)
                better, higher = self._best_of(model, effect, place, near)
                if better is None or higher <= score + settings.SHAPE_GAIN:
                    break
                shape, score = better, higher
        return shape, score

    def _best_of(
        self, model: FoldModel, effect: Effect, place: Place, shapes: Sequence[Shape]
    ) -> tuple[Shape | None, float]:
        """Admissible shape with the highest score, and the score; all have one width."""
        if not shapes:
            return None, -1.0
        key = (effect.name, place, tuple(shapes))
        stack = model.products.stack(key, self._columns(effect, place, shapes))
        scores, coefficients = model.scores_of(stack)
        for k in np.argsort(-scores, kind="stable"):
            if effect.admissible(shapes[k], coefficients[k]):
                return shapes[k], float(scores[k])
        return None, -1.0

    def _block(self, products: FoldProducts, effect: Effect, place: Place, shape: Shape) -> Block:
        return products.block((effect.name, place, shape), self._columns(effect, place, [shape])[0])

    def _columns(self, effect: Effect, place: Place, shapes: Sequence[Shape]) -> list[Columns]:
        """Rows of shapes; those that were never made are made together."""
        keys = [(effect.name, place, shape) for shape in shapes]
        new = [shape for shape, key in zip(shapes, keys, strict=True) if key not in self._rows]
        if new:
            for shape, rows in zip(new, rows_of(self.data, effect, place, new), strict=True):
                finite = all(np.isfinite(values).all() for values in rows.values())
                zero = {joint: np.zeros_like(values) for joint, values in rows.items()}
                self._rows[(effect.name, place, shape)] = rows if finite else zero
        return [self._rows[key] for key in keys]


def _with(base: Both, found: Sequence[FoldCandidate]) -> Both:
    for each in found:
        base = base.beside(each)
    return base
