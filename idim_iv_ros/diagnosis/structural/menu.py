"""Every shape of every effect at every place, in columns one beside the other.

The rows of the grids were made for the search; here they only get places in a long row of columns,
so that folds, null draws and confidence sets can treat thousands of them by products of matrices.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.diagnosis.structural.likelihood import Columns
from idim_iv_ros.effects.effect import Effect, OperatingRange, Place, Shape
from idim_iv_ros.types import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Entry:
    """Shapes of one kind of an effect at a place, all with as many columns.

    Attributes
    ----------
    effect : Effect
    place : Place
    shapes : tuple of Shape
    rows : sequence of Columns
        Of each shape, by joint (r_j, width), not whitened.
    first : int
        Place of its first column in the menu.
    tried : int
        Shapes of its branch of the grid.
    """

    effect: Effect
    place: Place
    shapes: tuple[Shape, ...]
    rows: Sequence[Columns]
    first: int
    tried: int

    @cached_property
    def width(self) -> int:
        """Columns of each shape."""
        return int(next(iter(self.rows[0].values())).shape[1])

    @property
    def columns(self) -> slice:
        """Places in the menu."""
        return slice(self.first, self.first + self.width * len(self.shapes))

    @property
    def joints(self) -> tuple[int, ...]:
        """Whose torque it moves."""
        return tuple(sorted(self.rows[0]))

    def at(self, joint: int) -> FloatArray:
        """Rows (r_j, shapes × width) of one joint; a column that is not finite is zero."""
        table = self._side_by_side(joint)
        if joint not in self._unusable:
            self._unusable[joint] = np.asarray(~np.isfinite(table).all(axis=0))
        if self._unusable[joint].any():
            table = np.where(self._unusable[joint], 0.0, table)
        return table

    @cached_property
    def _unusable(self) -> dict[int, NDArray[np.bool_]]:
        return {}

    def _side_by_side(self, joint: int) -> FloatArray:
        """The array that all shapes are parts of, if there is one; else a copy of them."""
        base = self.rows[0][joint].base
        first = np.concatenate([rows[joint][0] for rows in self.rows])
        whole = base is not None and base.ndim == 2 and base.shape[1] == len(first)
        if base is not None and whole and np.array_equal(base[0], first, equal_nan=True):
            return np.asarray(base)
        return np.hstack([rows[joint] for rows in self.rows])

    def numbers(self, shape: Shape) -> int:
        """What the candidate may choose: coefficients and shape."""
        return self.width + self.effect.free_numbers(shape)


@dataclass(frozen=True, eq=False)
class Menu:
    """All entries; see the module.

    Attributes
    ----------
    entries : tuple of Entry
    """

    entries: tuple[Entry, ...]

    @cached_property
    def total(self) -> int:
        """Number of columns."""
        return self.entries[-1].columns.stop if self.entries else 0

    @cached_property
    def widest(self) -> int:
        """Columns of the widest shape."""
        return max((each.width for each in self.entries), default=0)

    @cached_property
    def places(self) -> dict[int, IntArray]:
        """Places in the menu of the columns that each joint has, in the order of the entries."""
        found: dict[int, list[IntArray]] = {}
        for each in self.entries:
            for joint in each.joints:
                found.setdefault(joint, []).append(np.arange(self.total)[each.columns])
        return {joint: np.concatenate(parts) for joint, parts in found.items()}

    @cached_property
    def by_width(self) -> dict[int, tuple[IntArray, list[tuple[int, int]]]]:
        """First columns of all shapes of one width, and which entry and shape each is."""
        found: dict[int, tuple[list[int], list[tuple[int, int]]]] = {}
        for number, entry in enumerate(self.entries):
            starts, which = found.setdefault(entry.width, ([], []))
            starts += range(entry.columns.start, entry.columns.stop, entry.width)
            which += [(number, k) for k in range(len(entry.shapes))]
        return {width: (np.array(starts), which) for width, (starts, which) in found.items()}


def menu_of(
    catalogue: Sequence[Effect],
    covered: OperatingRange,
    made: Mapping[tuple[str, Place, tuple[Shape, ...]], Sequence[Columns]],
) -> Menu:
    """Arrange the grids that a search made; what it left out, it could not have found.

    Parameters
    ----------
    made
        Rows by effect, place and shapes: `Search.grids`.
    """
    entries: list[Entry] = []
    start = 0
    joints = len(covered.low)
    for effect in catalogue:
        for place in effect.places(joints):
            for branch in effect.branches(effect.grid(place, covered)):
                rows = made.get((effect.name, place, tuple(branch)))
                if not branch or rows is None:
                    continue
                for same in _of_equal_width(rows):
                    entry = Entry(
                        effect,
                        place,
                        tuple(branch[k] for k in same),
                        [rows[k] for k in same],
                        start,
                        len(branch),
                    )
                    entries.append(entry)
                    start = entry.columns.stop
    return Menu(tuple(entries))


def _of_equal_width(rows: Sequence[Columns]) -> list[list[int]]:
    found: dict[int, list[int]] = {}
    for k, each in enumerate(rows):
        found.setdefault(int(next(iter(each.values())).shape[1]), []).append(k)
    return list(found.values())
