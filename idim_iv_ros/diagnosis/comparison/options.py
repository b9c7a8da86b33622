"""All options of all candidates side by side, and their products with each other and the model."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.comparison.candidate import Candidate, Key, Kind, Scope
from idim_iv_ros.diagnosis.comparison.ledger import Ledger, RowNoise
from idim_iv_ros.effects.effect import Shape
from idim_iv_ros.signals.autoregression import AutoregressiveModel
from idim_iv_ros.types import BoolArray, FloatArray, IntArray, SingleArray

_AT_ONCE = 128  # columns that are whitened together
_SOMETHING = 0.5  # prior probability that there is something more
LOG_NOTHING = float(np.log(1.0 - _SOMETHING))
_SHAPES_OF_PRIOR = 5  # more shapes than these cost no presence


class Options:
    """Numbers of all options, and where their columns are.

    Of each option `candidate` and `shape`: place of its candidate in the list, and of its shape
    there; `first`, `width`: its columns among all of them; `of_width`: options of each width;
    `place`: of each option among those of its width; `columns`: (m_w, w) theirs. Columns of a
    candidate follow one another.
    """

    def __init__(self, ledger: Ledger, candidates: Sequence[Candidate]) -> None:
        self.ledger, self.candidates = ledger, tuple(candidates)
        self.candidate: IntArray = np.repeat(
            np.arange(len(candidates)), [len(c.shapes) for c in candidates]
        )
        self.shape = np.concatenate([np.arange(len(c.shapes)) for c in candidates]).astype(int)
        self.width = np.array([candidates[int(c)].width for c in self.candidate])
        self.first = np.concatenate([[0], np.cumsum(self.width)[:-1]]).astype(int)
        self.count = int(self.width.sum())
        self.of_width = {int(w): np.flatnonzero(self.width == w) for w in np.unique(self.width)}
        self.place = np.empty(len(self.width), dtype=int)
        for which in self.of_width.values():
            self.place[which] = np.arange(len(which))
        self.columns = {
            w: self.first[which][:, None] + np.arange(w) for w, which in self.of_width.items()
        }
        keys = [c.key for c in candidates]
        self.keys = list(dict.fromkeys(keys))
        number = {key: k for k, key in enumerate(self.keys)}
        self.key = np.array([number[keys[int(c)]] for c in self.candidate])
        kinds = [candidates[int(c)].kind for c in self.candidate]
        self.is_curve: BoolArray = np.array([kind is Kind.CURVE for kind in kinds])
        self.is_number: BoolArray = np.array([kind is Kind.NUMBER for kind in kinds])

    @cached_property
    def log_prior(self) -> FloatArray:
        """Logarithm of the prior probability of every option: of its effect, place and shape."""
        names: dict[tuple[str, Scope], list[int]] = {}
        weight = np.zeros(len(self.keys))
        for number, key in enumerate(self.keys):
            first = self.candidates[self.candidate[self.key == number][0]]
            curve = first.kind is Kind.CURVE
            weight[number] = settings.PRIOR_OF_CURVE if curve else first.effect.prior_weight
            name = "a free curve" if curve else key.effect
            names.setdefault((name, key.scope), []).append(number)
        for numbers in names.values():
            weight[numbers] /= len(numbers)
        weight *= _SOMETHING / weight.sum()
        return np.asarray(np.log(weight[self.key] / self._shapes))

    @cached_property
    def log_presence(self) -> FloatArray:
        """Logarithm of that of its effect at its place, whatever the shape."""
        return np.asarray(self.log_prior + np.log(np.minimum(self._shapes, _SHAPES_OF_PRIOR)))

    @property
    def _shapes(self) -> IntArray:
        """How many options the effect and place of each option have."""
        return np.asarray(np.bincount(self.key)[self.key])

    def odds_of_presence(self, key: Key) -> float:
        """Logarithm of the prior odds of an effect at a place against nothing more."""
        return float(self.log_presence[self.key == self.keys.index(key)][0]) - LOG_NOTHING

    @cached_property
    def torques(self) -> tuple[list[dict[int, FloatArray]], FloatArray, FloatArray]:
        """Inner (by joint), normal and shared products of rows by the torque: shares squared."""
        noise, model = [], []
        for rows, size in zip(self.ledger.joints, self.ledger.sizes, strict=True):
            flat = AutoregressiveModel(np.zeros(0), max(len(rows), 1) * float(size) ** 2)
            noise.append(RowNoise(flat, np.ones(len(rows))))
            model.append(flat.standardized(rows.matrix, rows.segments))
        return self.inner_products(noise), *self.products_with_model(model, noise)

    def named(self, option: int) -> tuple[Candidate, Shape]:
        """Candidate and shape of an option."""
        candidate = self.candidates[self.candidate[option]]
        return candidate, candidate.shapes[self.shape[option]]

    def inner_products(
        self, noise: Sequence[RowNoise], parts: Sequence[IntArray] | None = None
    ) -> list[dict[int, FloatArray]]:
        """Products (m_w, w, w) of the whitened columns of each option, over all joints, by part.

        `parts`: part (r_j,) that each row of a joint belongs to; None: the joint itself.
        """
        if parts is None:
            parts = [np.full(len(rows), j) for j, rows in enumerate(self.ledger.joints)]
        count = 1 + max(int(part.max(initial=0)) for part in parts)
        made = [
            {w: np.zeros((len(which), w, w)) for w, which in self.of_width.items()}
            for _ in range(count)
        ]
        for joint, first, table, w in self._tables():
            segments, options = self.ledger.joints[joint].segments, len(table) // w
            count_at_once = max(_AT_ONCE // w, 1)
            for start in range(0, options, count_at_once):
                stop = min(start + count_at_once, options)
                rows = noise[joint].standardized(table[start * w : stop * w].T, segments).T
                rows = rows.reshape(stop - start, w, -1)
                places = slice(first + start, first + stop)
                for k in np.unique(parts[joint]):
                    some = rows[:, :, parts[joint] == k]
                    # As a product of long and narrow matrices they take ten times as long.
                    dots = some[:, :, None, None] @ some[:, None, :, :, None]
                    made[k][w][self.place[places]] += dots[:, :, :, 0, 0]
        return made

    def _tables(self) -> Iterator[tuple[int, int, SingleArray, int]]:
        """Yield the lines of every candidate at every joint that counts: (joint, first, lines, w).

        `first`: number of the first option of the candidate, whose columns have the width w.
        """
        firsts = np.searchsorted(self.candidate, np.arange(len(self.candidates)))
        for candidate, first in zip(self.candidates, firsts.tolist(), strict=True):
            for joint, lines in candidate.lines.items():
                if not self.ledger.joints[joint].left_out:
                    yield joint, first, lines, candidate.width

    def products(
        self,
        noise: Sequence[RowNoise],
        right: Sequence[FloatArray],
        places: Sequence[IntArray] | None = None,
    ) -> FloatArray:
        """Products (p, q) of all columns, whitened, with whitened rows (r_j, q_j) of each joint.

        `places`: parameters of the model that the rows are of; None: q columns at every joint.
        """
        q = right[0].shape[1] if places is None else self.ledger.parameters
        made = np.zeros((self.count, q))
        single = [
            one.drawn_back(table, joint.segments).astype(np.float32) if table.any() else None
            for one, table, joint in zip(noise, right, self.ledger.joints, strict=True)
        ]
        for joint, first, table, _ in self._tables():
            rows = single[joint]
            if rows is not None:
                lines = slice(self.first[first], self.first[first] + len(table))
                made[lines, slice(None) if places is None else places[joint]] += table @ rows
        return made

    def products_with_model(
        self, model: Sequence[FloatArray], noise: Sequence[RowNoise]
    ) -> tuple[FloatArray, FloatArray]:
        """XᵀX (b, b) of the whitened model (r_j, c_j), and all whitened columns with X (p, b)."""
        normal = np.zeros((self.ledger.parameters, self.ledger.parameters))
        places = [joint.columns for joint in self.ledger.joints]
        for rows, columns in zip(model, places, strict=True):
            normal[np.ix_(columns, columns)] += rows.T @ rows
        return normal, self.products(noise, model, places)


@dataclass(frozen=True, eq=False)
class Whitened:
    """Rows of model and gap with the noise of each joint at unit variance, and their products.

    The columns of the options, which are by far the most, are not kept whitened: (W x)ᵀ y is xᵀ (Wᵀ
    y). Rows that are not counted are zero.
    """

    options: Options
    noise: tuple[RowNoise, ...]
    model: tuple[FloatArray, ...]  # (r_j, c_j)
    gap: tuple[FloatArray, ...]  # (r_j,)
    counted: tuple[BoolArray, ...]  # (r_j,)
    normal: FloatArray  # XᵀX (b, b)
    shared: FloatArray  # all columns with X (p, b)
    inner: dict[int, FloatArray]  # (m_w, w, w) products of the columns of each option
    by_joint: list[dict[int, FloatArray]]  # the same of all rows of each joint, counted or not

    @cached_property
    def score(self) -> FloatArray:
        """Products (p,) of all columns with the gap."""
        return self.options.products(self.noise, [left[:, None] for left in self.gap])[:, 0]

    def columns(self, columns: Mapping[int, FloatArray]) -> dict[int, FloatArray]:
        """Columns (r_j, w) with the noise at unit variance, of the rows that count."""
        joints = self.options.ledger.joints
        return {
            joint: self.noise[joint].standardized(table, joints[joint].segments)
            * self.counted[joint][:, None]
            for joint, table in columns.items()
            if not joints[joint].left_out
        }


def whitened(options: Options, noise: Sequence[RowNoise]) -> Whitened:
    """Whiten everything; rows of a joint that is left out weigh nothing."""
    ledger = options.ledger
    model, gap = [], []
    for joint, (rows, left) in enumerate(zip(ledger.joints, ledger.gap, strict=True)):
        kept = float(not rows.left_out)
        both = kept * noise[joint].standardized(np.column_stack([rows.matrix, left]), rows.segments)
        model.append(both[:, :-1])
        gap.append(both[:, -1])
    normal, shared = options.products_with_model(model, noise)
    by_joint = options.inner_products(noise)
    return Whitened(
        options=options,
        noise=tuple(noise),
        model=tuple(model),
        gap=tuple(gap),
        counted=tuple(np.full(len(rows), not rows.left_out) for rows in ledger.joints),
        normal=normal,
        shared=shared,
        inner={w: np.sum([inner[w] for inner in by_joint], axis=0) for w in options.of_width},
        by_joint=by_joint,
    )


def without_parts(white: Whitened, parts: Sequence[IntArray]) -> Iterator[Whitened]:
    """Yield the same without one part (r_j,) of the rows, for every part in turn."""
    inner = white.options.inner_products(white.noise, parts)
    for part, inner_of_part in enumerate(inner):
        kept = tuple(
            one & (number != part) for one, number in zip(white.counted, parts, strict=True)
        )
        model = tuple(rows * some[:, None] for rows, some in zip(white.model, kept, strict=True))
        gap = tuple(left * some for left, some in zip(white.gap, kept, strict=True))
        normal, shared = white.options.products_with_model(model, white.noise)
        left = {w: white.inner[w] - inner_of_part[w] for w in white.inner}
        yield replace(
            white, model=model, gap=gap, counted=kept, normal=normal, shared=shared, inner=left
        )
