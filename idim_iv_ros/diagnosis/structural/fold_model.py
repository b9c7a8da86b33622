"""The regression without one fold, and what every candidate of the menu would take off its
residual: algebra on products, in the coordinates of an orthonormal basis of the model.

An accepted candidate's columns are turned to be orthonormal beside the model, so that the next
candidates only lose what they share with these.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.diagnosis.structural.fold_products import EVERY_FOLD, Block, FoldProducts, Stack
from idim_iv_ros.estimation.qr import NOT_SHOWN, Basis, independent_basis
from idim_iv_ros.types import FloatArray

_LEAST_ENERGY = 1e-30
_ROUNDING = float(np.finfo(float).eps)  # of a sum, relative to its largest terms
_NOTHING = 1e-300  # energy of a joint without any torque
_LEAST_DIRECTION = 1e-6  # as `scan`: energy of a direction of unit columns


@dataclass(frozen=True, eq=False)
class Accepted:
    """A candidate in the model.

    Attributes
    ----------
    key : hashable
        Of its block.
    turn : (w, rank)
        Makes its columns orthonormal beside those before it.
    shared : (n, w)
        Its coordinates in the model before it.
    """

    key: Hashable
    turn: FloatArray
    shared: FloatArray


@dataclass(frozen=True, eq=False)
class View:
    """Columns of a candidate beside a model; see `FoldModel`.

    Attributes
    ----------
    shared : (n, w)
        Their coordinates in the model.
    left : (w, w)
        Products of what the model leaves of them.
    right : (w,)
        Products with the residual.
    inner : by joint (p_j, w)
        With the model's columns and the accepted ones at the joint.
    residual : by joint (w,)
        With the residual at the joint.
    own : by joint (w, w)
    energy : (w,)
    """

    shared: FloatArray
    left: FloatArray
    right: FloatArray
    inner: dict[int, FloatArray]
    residual: dict[int, FloatArray]
    own: dict[int, FloatArray]
    energy: FloatArray


class FoldModel:
    """A fit without one fold and with some accepted candidates.

    Parameters
    ----------
    products
    left_out
        Fold; `EVERY_FOLD` leaves none out.
    """

    def __init__(self, products: FoldProducts, left_out: int = EVERY_FOLD) -> None:
        self.products = products
        self.left_out = left_out
        self.weights = products.weights(left_out)
        self.accepted: tuple[Accepted, ...] = ()
        factor = products.model_factor(left_out)
        self.basis: Basis = independent_basis(factor[:, :-1], tolerance=NOT_SHOWN)
        self.coordinates = self.basis.vectors.T @ factor[:, -1]
        self.gram = [
            products.model_products(joint, left_out) for joint in range(len(products.joints))
        ]
        self.inner = {
            joint: np.tensordot(self.weights, parts, axes=1)
            for joint, parts in products.inner.items()
        }
        self.own = {
            joint: np.tensordot(self.weights, parts, axes=1)
            for joint, parts in products.own.items()
        }
        menu = products.menu
        whole = np.zeros((products.total + 1, menu.total))
        self.left = np.zeros((menu.total, menu.widest))
        for joint, places in menu.places.items():
            rows = np.append(products.joints[joint].columns, products.total)
            whole[np.ix_(rows, places)] += self.inner[joint]
            self.left[places] += self.own[joint]
        self.energy = self._diagonal(self.left)
        self.shared = self._on_basis(whole[:-1])
        self.right = whole[-1] - self.coordinates @ self.shared
        self.left = self.left - self._shared_products(self.shared)

    def beside(self, key: Hashable, block: Block) -> "FoldModel":
        """Return the same with one candidate more."""
        made = object.__new__(FoldModel)
        made.__dict__.update(self.__dict__)
        for name in ("values", "theta"):  # cached of this one
            made.__dict__.pop(name, None)
        view = self.view(block)
        turn = orthonormal(view.left, view.energy)[0]
        made.accepted = (*self.accepted, Accepted(key, turn, view.shared))
        made.gram = list(self.gram)
        made.inner = dict(self.inner)
        with_menu = self.products.with_menu(key)
        crossed = np.zeros((block.width, self.products.menu.total))
        for joint, own in block.own.items():
            among = view.inner[joint]
            gram = self.gram[joint]
            # The residual stays last.
            zero = self._with_residual(block, joint)
            size = len(gram) - 1 + block.width + 1
            larger = np.zeros((size, size))
            order = np.append(np.arange(len(gram) - 1), size - 1)
            larger[np.ix_(order, order)] = gram
            new = np.arange(len(gram) - 1, size - 1)
            larger[np.ix_(order[:-1], new)] = among
            larger[np.ix_(new, order[:-1])] = among.T
            larger[np.ix_(new, new)] = np.tensordot(self.weights, own, axes=1)
            larger[size - 1, new] = larger[new, size - 1] = zero
            made.gram[joint] = larger
            if joint in with_menu:
                product = np.tensordot(self.weights, with_menu[joint], axes=1)
                crossed[:, self.products.menu.places[joint]] += product
                inner = self.inner[joint]
                made.inner[joint] = np.vstack([inner[:-1], product, inner[-1:]])
        further = turn.T @ (crossed - view.shared.T @ self.shared)
        coordinate = turn.T @ view.right
        made.shared = np.vstack([self.shared, further])
        made.coordinates = np.concatenate([self.coordinates, coordinate])
        made.right = self.right - coordinate @ further
        made.left = self.left - made._shared_products(further)
        return made

    def view(self, block: Block) -> View:
        """Columns that are not of the menu, beside this model."""
        products = self.products
        whole = np.zeros((products.total, block.width))
        inner, own, residual = {}, {}, {}
        for joint, parts in block.inner.items():
            base = np.tensordot(self.weights, parts, axes=1)
            whole[products.joints[joint].columns] += base[:-1]
            inner[joint] = base[:-1]
            residual[joint] = base[-1]
            own[joint] = np.tensordot(self.weights, block.own[joint], axes=1)
        shared = self._on_basis(whole)
        right = np.asarray(sum(residual.values()))
        left = np.asarray(sum(own.values()))
        energy = np.diag(left).copy()
        start = self.basis.rank
        for each in self.accepted:
            other = products.block(each.key, {})
            crossed = np.zeros((other.width, block.width))
            for joint in set(other.white) & set(block.white):
                parts = products.between(joint, other, block)
                product = np.tensordot(self.weights, parts, axes=1)
                crossed += product
                inner[joint] = np.vstack([inner[joint], product])
            further = each.turn.T @ (crossed - each.shared.T @ shared)
            shared = np.vstack([shared, further])
            start += len(further)
        right = right - self.coordinates @ shared
        left = left - shared.T @ shared
        theta = self.theta
        residual = {j: residual[j] - theta[j] @ inner[j] for j in inner}
        return View(shared, left, right, inner, residual, own, energy)

    def view_of_menu(self, first: int, width: int) -> View:
        """Columns of the menu, beside this model."""
        columns = np.arange(first, first + width)
        inner, own, residual = {}, {}, {}
        for joint, places in self.products.menu.places.items():
            at = int(np.searchsorted(places, first))
            if at < len(places) and places[at] == first:
                part = slice(at, at + width)
                inner[joint] = self.inner[joint][:-1, part]
                own[joint] = self.own[joint][part, :width]
                residual[joint] = self.inner[joint][-1, part] - self.theta[joint] @ inner[joint]
        return View(
            self.shared[:, columns],
            self.left[columns, :width],
            self.right[columns],
            inner,
            residual,
            own,
            self.energy[columns],
        )

    def _with_residual(self, block: Block, joint: int) -> FloatArray:
        return np.asarray(np.tensordot(self.weights, block.inner[joint], axes=1)[-1])

    @cached_property
    def values(self) -> FloatArray:
        """(b,) then the coefficients of all accepted candidates: change from the products' fit."""
        return self._solved(self.coordinates)

    def _solved(self, coordinates: FloatArray) -> FloatArray:
        """Coefficients (b + k, …) that have these coordinates in the model's basis."""
        rest = np.array(coordinates, dtype=float)
        end = len(rest)
        found = []
        for each in reversed(self.accepted):
            start = end - each.turn.shape[1]
            own = each.turn @ rest[start:end]
            rest[:start] -= each.shared @ own
            found.append(own)
            end = start
        base = np.zeros((self.products.total, *rest.shape[1:]))
        base[self.basis.kept] = scipy.linalg.solve_triangular(
            self.basis.upper, rest[: self.basis.rank]
        )
        return np.concatenate([base, *reversed(found)])

    def at_joints(self, values: FloatArray) -> list[FloatArray]:
        """Coefficients (b + k, …) by joint, in the order of the joint's columns."""
        made = [values[rows.columns] for rows in self.products.joints]
        start = self.products.total
        for each in self.accepted:
            block = self.products.block(each.key, {})
            own = values[start : start + block.width]
            start += block.width
            for joint in block.white:
                made[joint] = np.concatenate([made[joint], own])
        return made

    @cached_property
    def theta(self) -> list[FloatArray]:
        """The same by joint, see `at_joints`."""
        return self.at_joints(self.values)

    def energies(self) -> FloatArray:
        """(n_joints,) of the weighted residual; no less than what rounding leaves of it."""
        made = []
        for gram, theta in zip(self.gram, self.theta, strict=True):
            signed = np.append(-theta, 1.0)
            least = rounding(np.abs(signed) @ norms(gram))
            made.append(float(np.maximum(signed @ gram @ signed, least)))
        return np.array(made)

    def with_candidates(self, views: Sequence[View]) -> tuple[list[FloatArray], FloatArray]:
        """Coefficients of each candidate, and energies (m, n_joints) with it in the model.

        An energy is a difference of products: where a candidate explains everything, as in a
        simulation without noise, no digit of it is known. It is then as large as its rounding.
        """
        if not views:
            return [], np.zeros((0, len(self.gram)))
        coefficients = [least_squares(each.left, each.right, each.energy) for each in views]
        changes = self.changes(views, coefficients)
        energies = np.tile(self.energies(), (len(views), 1))
        for joint, (gram, theta, change) in enumerate(
            zip(self.gram, self.theta, changes, strict=True)
        ):
            slope = gram[:-1, -1] - gram[:-1, :-1] @ theta
            sizes = norms(gram)
            terms = sizes[-1] + sizes[:-1] @ np.abs(theta[:, None] + change)
            energies[:, joint] += np.einsum("pm,pm->m", change, gram[:-1, :-1] @ change)
            energies[:, joint] -= 2.0 * slope @ change
            for k, (each, c) in enumerate(zip(views, coefficients, strict=True)):
                if joint in each.inner:
                    energies[k, joint] += c @ (
                        each.own[joint] @ c
                        - 2.0 * each.residual[joint]
                        + 2.0 * each.inner[joint].T @ change[:, k]
                    )
                    terms[k] += norms(each.own[joint]) @ np.abs(c)
            energies[:, joint] = np.maximum(energies[:, joint], rounding(terms))
        return coefficients, energies

    def changes(
        self, views: Sequence[View], coefficients: Sequence[FloatArray]
    ) -> list[FloatArray]:
        """By joint, what each candidate (m) changes of the model's coefficients: (p_j, m)."""
        moved = np.column_stack(
            [each.shared @ c for each, c in zip(views, coefficients, strict=True)]
        )
        return self.at_joints(-self._solved(moved))

    def scores(self) -> dict[int, tuple[FloatArray, FloatArray]]:
        """Score (m,) and coefficients (m, w) of every shape of the menu, by width."""
        found = {}
        for width, (starts, _) in self.products.menu.by_width.items():
            columns = starts[:, None] + np.arange(width)
            turn = orthonormal(self.left[columns, :width], self.energy[columns], stacked=True)
            seen = np.einsum("mwr,mw->mr", turn, self.right[columns])
            found[width] = np.sum(seen**2, axis=1), np.einsum("mwr,mr->mw", turn, seen)
        return found

    def scores_of(self, stack: Stack) -> tuple[FloatArray, FloatArray]:
        """Scores (m,) and coefficients (m, w) of several shapes that are not of the menu."""
        products = self.products
        count = next(iter(stack.white.values())).shape[1]
        whole = np.zeros((products.total + 1, count))
        left = np.zeros((count, stack.width))
        for joint, parts in stack.inner.items():
            rows = np.append(products.joints[joint].columns, products.total)
            whole[rows] += np.tensordot(self.weights, parts, axes=1)
            left += np.tensordot(self.weights, stack.own[joint], axes=1)
        shared = self._on_basis(whole[:-1])
        for each in self.accepted:
            other = products.block(each.key, {})
            crossed = np.zeros((other.width, count))
            for joint in set(other.white) & set(stack.white):
                parts = products.between(joint, other, stack)
                crossed += np.tensordot(self.weights, parts, axes=1)
            shared = np.vstack([shared, each.turn.T @ (crossed - each.shared.T @ shared)])
        right = (whole[-1] - self.coordinates @ shared).reshape(-1, stack.width)
        energy = np.einsum("mii->mi", left.reshape(-1, stack.width, stack.width)).copy()
        by_shape = shared.reshape(
            len(shared), shared.shape[1] // stack.width, stack.width
        ).transpose(1, 0, 2)
        remaining = left.reshape(-1, stack.width, stack.width) - np.matmul(
            by_shape.transpose(0, 2, 1), by_shape
        )
        turn = orthonormal(remaining, energy, stacked=True)
        seen = np.einsum("mwr,mw->mr", turn, right)
        return np.sum(seen**2, axis=1), np.einsum("mwr,mr->mw", turn, seen)

    def _on_basis(self, whole: FloatArray) -> FloatArray:
        return np.asarray(
            scipy.linalg.solve_triangular(self.basis.upper, whole[self.basis.kept], trans="T")
        )

    def _shared_products(self, shared: FloatArray) -> FloatArray:
        """Products of each menu column's coordinates with those of its shape, (C, widest)."""
        made = np.zeros_like(self.left)
        for width, (starts, _) in self.products.menu.by_width.items():
            columns = starts[:, None] + np.arange(width)
            part = shared[:, columns].transpose(1, 0, 2)
            made[columns, :width] = np.matmul(part.transpose(0, 2, 1), part)
        return made

    def _diagonal(self, left: FloatArray) -> FloatArray:
        made = np.zeros(len(left))
        for width, (starts, _) in self.products.menu.by_width.items():
            for k in range(width):
                made[starts + k] = left[starts + k, k]
        return made


def norms(products: FloatArray) -> FloatArray:
    """Norms (p,) of columns with these products (p, p)."""
    return np.asarray(np.sqrt(np.maximum(np.diag(products), 0.0)))


def rounding(terms: FloatArray) -> FloatArray:
    """Energy that rounding may leave of a sum of vectors whose norms add up to `terms`.

    By the inequality of Cauchy and Schwarz no product in it is larger than the square of `terms`.
    """
    return np.maximum(_ROUNDING * np.square(terms), _NOTHING)


def orthonormal(left: FloatArray, energy: FloatArray, *, stacked: bool = False) -> FloatArray:
    """Turn (…, w, w) of columns into orthonormal ones; what the model absorbs becomes zero.

    Parameters
    ----------
    left
        (…, w, w) products of what the model leaves of the columns.
    energy
        (…, w) of the columns themselves.
    """
    left = left if stacked else left[None]
    energy = energy if stacked else energy[None]
    remaining = np.einsum("mii->mi", left)
    usable = remaining > np.maximum(settings.LEAST_INDEPENDENT * energy, _LEAST_ENERGY)
    scale = np.where(usable, 1.0 / np.sqrt(np.where(usable, remaining, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(left * scale[:, :, None] * scale[:, None, :])
    shown = values > _LEAST_DIRECTION
    root = np.where(shown, 1.0 / np.sqrt(np.where(shown, values, 1.0)), 0.0)
    return np.asarray(scale[:, :, None] * vectors * root[:, None, :])


def least_squares(left: FloatArray, right: FloatArray, energy: FloatArray) -> FloatArray:
    """Coefficients (w,) of one candidate; zero of what the model absorbs."""
    turn = orthonormal(left, energy)[0]
    return np.asarray(turn @ (turn.T @ right))
