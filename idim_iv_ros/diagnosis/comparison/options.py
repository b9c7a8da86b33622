"""All options of all candidates side by side, and their products with each other and the model."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from idim_iv_ros.diagnosis.comparison.candidate import Candidate, Kind
from idim_iv_ros.diagnosis.comparison.ledger import Ledger, RowNoise
from idim_iv_ros.memory import return_freed_memory
from idim_iv_ros.types import BoolArray, FloatArray, IntArray

_AT_ONCE = 128  # columns that are whitened together


class Options:
    """Numbers of all options, and where their columns are.

    Attributes
    ----------
    candidate, shape : (m,) int
        Of each option: place of its candidate in the list, and of its shape there.
    first, width : (m,) int
        Its columns among all of them.
    of_width : dict of int to (m_w,) int
        Options of each width.
    place : (m,) int
        Place of each option among those of its width.
    columns : dict of int to (m_w, w) int
        Their columns.
    lines : tuple of (p_j, r_j) float32
        Torque of unit coefficients at each joint, one line a column.
    at : tuple of (p,) int
        Line of each column at a joint; −1 where it has none.
    """

    def __init__(self, ledger: Ledger, candidates: Sequence[Candidate]) -> None:
        self.ledger, self.candidates = ledger, tuple(candidates)
        self.candidate: IntArray = np.repeat(
            np.arange(len(candidates)), [c.options for c in candidates]
        )
        self.shape = np.concatenate([np.arange(c.options) for c in candidates]).astype(int)
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
        starts = np.concatenate([[0], np.cumsum([c.options * c.width for c in candidates])])
        lines, at = [], []
        for joint, rows in enumerate(ledger.joints):
            there = [k for k, c in enumerate(candidates) if joint in c.lines]
            place = np.full(self.count, -1)
            spans = [np.arange(starts[k], starts[k + 1]) for k in there]
            if spans:
                place[np.concatenate(spans)] = np.arange(sum(map(len, spans)))
                table = np.concatenate([candidates[k].lines[joint] for k in there])
                ends = np.cumsum([len(candidates[k].lines[joint]) for k in there])
                for k, end in zip(there, ends, strict=True):  # nothing is held twice
                    lines_of = candidates[k].lines
                    lines_of[joint] = table[end - len(lines_of[joint]) : end]
                return_freed_memory()
            else:
                table = np.zeros((0, len(rows)), dtype=np.float32)
            lines.append(np.zeros_like(table) if rows.left_out else table)
            at.append(place)
        self.lines, self.at = tuple(lines), tuple(at)
        keys = [c.key for c in candidates]
        self.keys = list(dict.fromkeys(keys))
        number = {key: k for k, key in enumerate(self.keys)}
        self.key = np.array([number[keys[int(c)]] for c in self.candidate])
        self.kinds = np.array([candidates[int(c)].kind.value for c in self.candidate])
        self.is_curve: BoolArray = self.kinds == Kind.CURVE.value
        self.is_number: BoolArray = self.kinds == Kind.NUMBER.value

    def inner_products(
        self, noise: Sequence[RowNoise], parts: Sequence[IntArray] | None = None
    ) -> list[dict[int, FloatArray]]:
        """Products (m_w, w, w) of the whitened columns of each option, over all joints, by part.

        Parameters
        ----------
        parts
            Part (r_j,) that each row of a joint belongs to; None: one for all.
        """
        count = 1 if parts is None else 1 + max(int(part.max(initial=0)) for part in parts)
        made = [
            {w: np.zeros((len(which), w, w)) for w, which in self.of_width.items()}
            for _ in range(count)
        ]
        for joint, (place, table) in enumerate(zip(self.at, self.lines, strict=True)):
            segments = self.ledger.joints[joint].segments
            for w, columns in self.columns.items():
                there = np.flatnonzero(place[columns[:, 0]] >= 0)
                count_at_once = max(_AT_ONCE // w, 1)
                for start in range(0, len(there), count_at_once):
                    some = there[start : start + count_at_once]
                    plain = table[place[columns[some]].ravel()].astype(float)
                    white = noise[joint].standardized(plain.T, segments).T
                    rows = white.astype(np.float32).reshape(len(some), w, -1)
                    for k in range(count):
                        part = rows if parts is None else rows[:, :, parts[joint] == k]
                        made[k][w][some] += np.matmul(part, part.transpose(0, 2, 1))
        return made

    def products(self, right: Sequence[FloatArray]) -> FloatArray:
        """Products (p, q) of all columns with some rows (r_j, q) of each joint."""
        made = np.zeros((self.count, right[0].shape[1]))
        for place, table, rows in zip(self.at, self.lines, right, strict=True):
            if len(table) and rows.any():
                there = np.flatnonzero(place >= 0)
                made[there] += (table @ rows.astype(np.float32))[place[there]]
        return made


@dataclass(frozen=True, eq=False)
class Whitened:
    """Rows of model and gap with the noise of each joint at unit variance, and their products.

    The columns of the options, which are by far the most, are not kept whitened: (W x)ᵀ y is
    xᵀ (Wᵀ y).

    Attributes
    ----------
    noise : tuple of RowNoise
    model : tuple of (r_j, c_j)
    gap : tuple of (r_j,)
    counted : tuple of (r_j,) bool
        Rows that count; those of model and gap that do not are zero.
    normal : (b, b)
        XᵀX.
    shared : (b, p)
        Xᵀ with all columns.
    inner : dict of int to (m_w, w, w)
        Products of the columns of each option.
    """

    noise: tuple[RowNoise, ...]
    model: tuple[FloatArray, ...]
    gap: tuple[FloatArray, ...]
    counted: tuple[BoolArray, ...]
    normal: FloatArray
    shared: FloatArray
    inner: dict[int, FloatArray]

    def with_options(self, options: Options, rows: Sequence[FloatArray]) -> FloatArray:
        """Products (p, q) of all columns, whitened, with whitened rows (r_j, q)."""
        return options.products(_drawn_back(options, self.noise, rows))


def whitened(options: Options, noise: Sequence[RowNoise]) -> Whitened:
    """Whiten everything; rows of a joint that is left out weigh nothing."""
    ledger = options.ledger
    model, gap = [], []
    for joint, (rows, left) in enumerate(zip(ledger.joints, ledger.gap, strict=True)):
        kept = float(not rows.left_out)
        both = kept * noise[joint].standardized(np.column_stack([rows.matrix, left]), rows.segments)
        model.append(both[:, :-1])
        gap.append(both[:, -1])
    normal, shared = products_with_model(options, model, noise)
    return Whitened(
        noise=tuple(noise),
        model=tuple(model),
        gap=tuple(gap),
        counted=tuple(np.full(len(rows), not rows.left_out) for rows in ledger.joints),
        normal=normal,
        shared=shared,
        inner=options.inner_products(noise)[0],
    )


def without_parts(
    options: Options, white: Whitened, parts: Sequence[IntArray]
) -> Iterator[Whitened]:
    """Yield whitened rows and products without one part of the rows, for every part in turn.

    Parameters
    ----------
    parts
        Number (r_j,) of the part that each row of a joint belongs to.
    """
    inner = options.inner_products(white.noise, parts)
    for part, inner_of_part in enumerate(inner):
        kept = tuple(
            one & (number != part) for one, number in zip(white.counted, parts, strict=True)
        )
        model = tuple(rows * some[:, None] for rows, some in zip(white.model, kept, strict=True))
        gap = tuple(left * some for left, some in zip(white.gap, kept, strict=True))
        normal, shared = products_with_model(options, model, white.noise)
        left = {w: white.inner[w] - inner_of_part[w] for w in white.inner}
        yield replace(
            white, model=model, gap=gap, counted=kept, normal=normal, shared=shared, inner=left
        )


def _drawn_back(
    options: Options, noise: Sequence[RowNoise], rows: Sequence[FloatArray]
) -> list[FloatArray]:
    """Wᵀ rows (r_j, q), of what differs from zero."""
    return [
        one.drawn_back(table, joint.segments) if table.any() else table
        for one, table, joint in zip(noise, rows, options.ledger.joints, strict=True)
    ]


def products_with_model(
    options: Options, model: Sequence[FloatArray], noise: Sequence[RowNoise]
) -> tuple[FloatArray, FloatArray]:
    """XᵀX (b, b) of the whitened model (r_j, c_j), and Xᵀ (b, p) with all whitened columns."""
    b = options.ledger.parameters
    normal, shared = np.zeros((b, b)), np.zeros((b, options.count))
    for joint, (rows, drawn, table, place) in enumerate(
        zip(model, _drawn_back(options, noise, model), options.lines, options.at, strict=True)
    ):
        columns: IntArray = options.ledger.joints[joint].columns
        normal[np.ix_(columns, columns)] += rows.T @ rows
        if len(table):
            there = np.flatnonzero(place >= 0)
            product = (table @ drawn.astype(np.float32))[place[there]]
            shared[np.ix_(columns, there)] += product.T
    return normal, shared
