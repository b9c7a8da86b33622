"""Products of the columns of model, torque and candidates, fold by fold: leaving one out is a
subtraction.

Rows are whitened once, with the noise of the final fit. Of the model's own columns the R factor of
every fold is kept, so that their conditioning is not squared; of candidates, products with the
model's columns, with the residual, and with the other columns of the same shape. Products with an
accepted effect are made when it is accepted: its columns go through the transposed whitening, so
that the candidates' rows serve as they are.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.structural.likelihood import Columns, Regression
from idim_iv_ros.diagnosis.structural.menu import Menu
from idim_iv_ros.estimation.qr import r_factor, stacked_r_factor
from idim_iv_ros.signals import AutoregressiveModel
from idim_iv_ros.types import FloatArray, IntArray

EVERY_FOLD = -1  # instead of a fold that is left out: none
_LARGEST = 1e30  # whitened


@dataclass(frozen=True, eq=False)
class Block:
    """Columns of one candidate.

    Attributes
    ----------
    plain, white : Columns
        (r_j, w) by joint.
    inner : by joint (folds, c_j + 1, w)
        Products with the model's columns and, last, the residual.
    own : by joint (folds, w, w)
    """

    plain: Columns
    white: Columns
    inner: dict[int, FloatArray]
    own: dict[int, FloatArray]

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(next(iter(self.plain.values())).shape[1])


@dataclass(frozen=True, eq=False)
class Stack:
    """Columns of several shapes of one effect and place, all with as many columns.

    Attributes
    ----------
    width : int
        Of each shape.
    white : Columns
        (r_j, shapes × width) by joint.
    inner : by joint (folds, c_j + 1, shapes × width)
    own : by joint (folds, shapes × width, width)
        Products of each column with those of its shape.
    """

    width: int
    white: Columns
    inner: dict[int, FloatArray]
    own: dict[int, FloatArray]


class FoldProducts:
    """Products of one regression with one set of weights; see the module.

    Parameters
    ----------
    regression
        Of the refit, without effects.
    noise_models
        Of each joint; white ones for the weights of the least torque gap.
    values
        (b,) about which products are taken: those of a fit lose the fewest digits.
    folds
        Fold of every row of every joint; rows with −1 belong to none and count nowhere.
    """

    def __init__(
        self,
        regression: Regression,
        noise_models: Sequence[AutoregressiveModel],
        values: FloatArray,
        folds: Sequence[IntArray],
        menu: Menu,
        draws: Sequence[NDArray[np.float32]] = (),
    ) -> None:
        self.regression = regression
        self.joints = regression.joints
        self.total = regression.total
        self.values = values
        self.menu = menu
        self.folds = folds
        self.count = 1 + max(int(fold.max()) for fold in folds)
        self.noise_models = tuple(noise_models)
        self.rows = np.array(
            [np.bincount(fold[fold >= 0], minlength=self.count) for fold in folds], float
        )
        self.white = [
            noise.standardized(np.column_stack([rows.matrix, rows.residual(values)]), rows.segments)
            for rows, noise in zip(self.joints, noise_models, strict=True)
        ]
        self.factors = [
            [r_factor(table[fold == k]) for k in range(self.count)]
            for table, fold in zip(self.white, folds, strict=True)
        ]
        self.draws = draws
        self._inside = [
            [_contiguous(np.flatnonzero(fold == k)) for k in range(self.count)] for fold in folds
        ]
        self._blocks: dict[Hashable, Block] = {}
        self._stacks: dict[Hashable, Stack] = {}
        self._beside: dict[Hashable, dict[int, FloatArray]] = {}
        self._of_menu()

    def without_menu(self) -> "FoldProducts":
        """Return the same for columns that are named one by one."""
        return FoldProducts(self.regression, self.noise_models, self.values, self.folds, Menu(()))

    def weights(self, left_out: int) -> FloatArray:
        """Weight of each fold (folds,) where one is left out: a thousandth, see `FOLD_LEAK`."""
        weights = np.ones(self.count)
        if left_out != EVERY_FOLD:
            weights[left_out] = settings.FOLD_LEAK
        return weights

    def model_factor(self, left_out: int) -> FloatArray:
        """R factor of [model residual] of all joints: (≤ b + 1, b + 1)."""
        roots = np.sqrt(self.weights(left_out))
        parts = [
            np.vstack([root * factor for root, factor in zip(roots, factors, strict=True)])
            for factors in self.factors
        ]
        return stacked_r_factor(parts, [rows.places for rows in self.joints], self.total + 1)

    def model_products(self, joint: int, left_out: int) -> FloatArray:
        """(c_j + 1, c_j + 1) of one joint's model columns and residual."""
        factors = self.factors[joint]
        weights = self.weights(left_out)
        return np.asarray(sum(w * (f.T @ f) for w, f in zip(weights, factors, strict=True)))

    def _of_menu(self) -> None:
        places = self.menu.places
        self.inner = {
            joint: np.zeros((self.count, len(self.joints[joint].columns) + 1, len(columns)))
            for joint, columns in places.items()
        }
        self.own = {
            joint: np.zeros((self.count, len(columns), self.menu.widest))
            for joint, columns in places.items()
        }
        self.drawn = {
            joint: np.zeros((len(columns), self.draws[joint].shape[1]), np.float32)
            for joint, columns in places.items()
            if len(self.draws)
        }
        done = dict.fromkeys(places, 0)
        for entry in self.menu.entries:
            for joint in entry.joints:
                white = self._whitened(joint, entry.at(joint))
                part = slice(done[joint], done[joint] + white.shape[1])
                done[joint] = part.stop
                for k in range(self.count):
                    inside = self._rows_of(joint, k)
                    own = white[inside]
                    self.inner[joint][k][:, part] = self.white[joint][inside].T @ own
                    self.own[joint][k][part, : entry.width] = _own(own, entry.width)
                if len(self.draws):
                    # A shape that overshoots all bounds is no candidate: single precision has none.
                    usable = np.abs(white).max(axis=0, initial=0.0) < _LARGEST
                    lines = np.where(usable, white, 0.0).T.astype(np.float32)
                    self.drawn[joint][part] = lines @ self.draws[joint]

    def _whitened(self, joint: int, rows: FloatArray) -> FloatArray:
        return self.noise_models[joint].standardized(rows, self.joints[joint].segments)

    def _rows_of(self, joint: int, fold: int) -> slice | IntArray:
        return self._inside[joint][fold]

    def block(self, key: Hashable, plain: Columns) -> Block:
        """Products of a candidate's columns; made once for a key."""
        if key not in self._blocks:
            white = {joint: self._whitened(joint, rows) for joint, rows in plain.items()}
            inner, own = {}, {}
            for joint, rows in white.items():
                parts = [(self._rows_of(joint, k)) for k in range(self.count)]
                inner[joint] = np.array([self.white[joint][p].T @ rows[p] for p in parts])
                own[joint] = np.array([rows[p].T @ rows[p] for p in parts])
            self._blocks[key] = Block(plain, white, inner, own)
        return self._blocks[key]

    def stack(self, key: Hashable, plain: Sequence[Columns]) -> Stack:
        """Products of several shapes at once; made once for a key."""
        if key not in self._stacks:
            width = int(next(iter(plain[0].values())).shape[1])
            white = {
                joint: self._whitened(joint, np.hstack([rows[joint] for rows in plain]))
                for joint in plain[0]
            }
            inner, own = {}, {}
            for joint, rows in white.items():
                parts = [self._rows_of(joint, k) for k in range(self.count)]
                inner[joint] = np.array([self.white[joint][p].T @ rows[p] for p in parts])
                own[joint] = np.array([_own(rows[p], width) for p in parts])
            self._stacks[key] = Stack(width, white, inner, own)
        return self._stacks[key]

    def between(self, joint: int, one: Block, other: Block | Stack) -> FloatArray:
        """Products of two candidates at a joint that both have: (folds, w1, w2)."""
        parts = [self._rows_of(joint, k) for k in range(self.count)]
        return np.array([one.white[joint][p].T @ other.white[joint][p] for p in parts])

    def with_menu(self, key: Hashable) -> dict[int, FloatArray]:
        """Products of a block with the menu, by joint (folds, w, columns); made once."""
        if key not in self._beside:
            block = self._blocks[key]
            found = {}
            for joint, rows in block.white.items():
                if joint not in self.menu.places:
                    continue
                back = [self._back(joint, rows, k) for k in range(self.count)]
                together = np.hstack(back).T
                at = [e.at(joint) for e in self.menu.entries if joint in e.joints]
                product = np.hstack([together @ table for table in at])
                found[joint] = product.reshape(self.count, block.width, -1)
            self._beside[key] = found
        return self._beside[key]

    def rest(
        self, joint: int, rows: NDArray[np.bool_], blocks: Sequence[Block], values: FloatArray
    ) -> FloatArray:
        """Weighted residual (n, m) at rows of a joint with other coefficients (p, m).

        Parameters
        ----------
        blocks
            Accepted candidates, in their order; `values` has the coefficients of the joint's own.
        """
        added = [block.white[joint][rows] for block in blocks if joint in block.white]
        columns = np.hstack([self.white[joint][rows, :-1], *added])
        return np.asarray(self.white[joint][rows, -1:] - columns @ values)

    def _back(self, joint: int, white: FloatArray, fold: int) -> FloatArray:
        """Transposed whitening of a fold's rows: its products with plain rows are whitened ones."""
        kept = np.where((self.folds[joint] == fold)[:, None], white, 0.0)
        noise = self.noise_models[joint]
        return noise.whiten_adjoint(kept, self.joints[joint].segments) / noise.sigma


def _contiguous(rows: IntArray) -> slice | IntArray:
    """A slice where rows follow one another: it needs no copy."""
    if len(rows) and rows[-1] - rows[0] + 1 == len(rows):
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows


def _own(rows: FloatArray, width: int) -> FloatArray:
    """Products of each column with those of its own shape: (columns, width)."""
    shapes = rows.reshape(len(rows), rows.shape[1] // width, width).transpose(1, 0, 2)
    return np.asarray(np.matmul(shapes.transpose(0, 2, 1), shapes)).reshape(-1, width)
