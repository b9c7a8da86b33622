"""What may close the gap: numbers of the model, effects of the catalogue, signals, free curves."""

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from idim_iv_ros.diagnosis.comparison.curves import NONPARAMETRIC, SIGNALS
from idim_iv_ros.diagnosis.comparison.ledger import numbers_not_given
from idim_iv_ros.diagnosis.identifiability import cannot_show, too_little
from idim_iv_ros.diagnosis.refit.baseline import Baseline, rows_of
from idim_iv_ros.diagnosis.refit.refit import unit_gravity_rows
from idim_iv_ros.effects.effect import Effect, Place, Shape
from idim_iv_ros.effects.parametric_effect import (
    Change,
    Estimated,
    ParameterSpace,
    ParametricEffect,
)
from idim_iv_ros.effects.registry import PARAMETRIC, STRUCTURAL
from idim_iv_ros.estimation.likelihood import Columns, width_of
from idim_iv_ros.types import BoolArray, FloatArray, SingleArray

Scope = frozenset[int]  # recordings in which something acts; empty: all
_LARGEST = 1e12  # N m of a unit coefficient: no hardware


class Key(NamedTuple):
    """Name of an effect, the joints of its place if it has one, and where it acts."""

    effect: str
    joint: int | None
    other: int | None
    scope: Scope


class Kind(Enum):
    """What a candidate is part of."""

    NUMBER = "number"
    EFFECT = "effect"
    SIGNAL = "signal"
    CURVE = "curve"


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect at one place, with all shapes of one width that are tried.

    `lines`: torque of unit coefficients by joint, N m, (options × width, r_j): the columns of one
    option after those of the option before.
    """

    kind: Kind
    effect: Effect | ParametricEffect
    place: Place | None  # None where a number belongs to no joint
    shapes: tuple[Shape, ...]  # one for each option; without numbers where there are changes
    changes: tuple[Change, ...]  # of the nominal numbers
    lines: dict[int, SingleArray]
    width: int  # columns of an option
    scope: Scope = frozenset()

    @property
    def key(self) -> Key:
        """Effect, place and scope, whatever the shape."""
        joint, other = (None, None) if self.place is None else (self.place.joint, self.place.other)
        return Key(self.effect.name, joint, other, self.scope)

    def estimates(self, values: FloatArray, deviations: FloatArray) -> list[Estimated]:
        """Changes of a number with their values and deviations (w,)."""
        rows = zip(self.changes, values.tolist(), deviations.tolist(), strict=True)
        return [Estimated(*row) for row in rows]

    def is_no_base_parameter(self, space: ParameterSpace) -> bool:
        """Whether no base parameters make up for this number, such as a tilt of gravity."""
        return any(change.direction[len(space.given) :].any() for change in self.changes)

    @cached_property
    def ranges(self) -> dict[tuple[type[Shape], int], tuple[FloatArray, FloatArray]]:
        """Least and largest numbers of the shapes of one type and count of numbers."""
        alike: dict[tuple[type[Shape], int], list[tuple[float, ...]]] = {}
        for shape in self.shapes:
            alike.setdefault((type(shape), len(shape.numbers)), []).append(shape.numbers)
        return {
            kind: (np.min(table, axis=0), np.max(table, axis=0)) for kind, table in alike.items()
        }


class Catalogue:
    """Candidates of one session, and what physics allows of them.

    Numbers of which the nominal model says nothing are free in every comparison: they are
    `not_given`, and no candidates.

    `without`: effects that are left out; `hidden`: effects and joints that the recording cannot
    show.
    """

    def __init__(
        self,
        data: Baseline,
        without: Collection[str] = (),
        hidden: Collection[tuple[str, int]] = (),
    ) -> None:
        self.data = data
        model = data.prepared.model
        axes = level_axes(model.robot.gravity)
        still = {joint for joint, covered in enumerate(data.covered) if too_little(covered)}
        missing = numbers_not_given(data.prepared)
        not_given = frozenset((kind, joint) for kind, joint in missing if joint not in still)
        self.space = ParameterSpace(model, model.given, axes, not_given)
        self._hidden = frozenset(hidden)
        self._numbers = [] if data.prepared.why_no_given else self._parametric(without, still)
        self.not_given = tuple(
            number
            for number in self._numbers
            if isinstance(number.effect, ParametricEffect)
            and number.place is not None
            and number.effect.is_not_given(self.space, number.place.joint)
        )
        self.candidates = (
            *self._effects([e for e in STRUCTURAL if e.name not in without], Kind.EFFECT),
            *self._effects(NONPARAMETRIC, Kind.CURVE),
            *self._effects(SIGNALS, Kind.SIGNAL),
            *(number for number in self._numbers if number not in self.not_given),
        )

    def differing(
        self,
        scopes: Sequence[Scope],
        number_scopes: Sequence[Scope],
        common: Collection[Key] | None = None,
    ) -> "Catalogue":
        """Return the same with candidates that act in some recordings only.

        What all recordings share has free numbers, and those that base parameters hold are no
        candidates. A gain is one of the torque that the estimate needs: errors of the nominal model
        would be in it.

        `scopes`, `number_scopes`: recordings in which effects, and numbers, may differ from the
        others; effects are no candidates where there are no `scopes` for them. `common`: those that
        all recordings may share; None: every effect.
        """
        kinds = {Kind.EFFECT, Kind.CURVE} if scopes else {Kind.CURVE}
        effects = [candidate for candidate in self.candidates if candidate.kind in kinds]
        shared = [e for e in effects if common is None or e.kind is Kind.CURVE or e.key in common]
        made = copy(self)
        estimate = self.data.estimate.linear.values
        made.space = replace(self.space, given=estimate, not_given=frozenset(), is_free=True)
        made.not_given = ()
        units = change_rows(self.data, made.space) if self._numbers else ()
        numbers = [replace(n, lines=_lines(units, n.changes)) for n in self._numbers]
        made.candidates = (
            *shared,
            *(candidate for candidate in self.candidates if candidate.kind is Kind.SIGNAL),
            *(n for n in numbers if n.is_no_base_parameter(self.space)),
            *(self._scoped(effect, scope) for scope in scopes for effect in effects),
            *(self._scoped(number, scope) for scope in number_scopes for number in numbers),
        )
        return made

    def _scoped(self, candidate: Candidate, scope: Scope) -> Candidate:
        """Let a candidate act in some recordings only."""
        lines = {
            joint: table * self._inside(joint, scope) for joint, table in candidate.lines.items()
        }
        return replace(candidate, lines=lines, scope=scope)

    def _inside(self, joint: int, scope: Scope) -> BoolArray:
        """Rows (r_j,) of some recordings."""
        return np.isin(self.data.recordings[joint], list(scope))

    def columns_of(self, candidate: Candidate, shapes: Sequence[Shape]) -> list[Columns]:
        """Rows (r_j, w) of an effect in other shapes, in its scope."""
        effect, place, scope = candidate.effect, candidate.place, candidate.scope
        assert not isinstance(effect, ParametricEffect) and place is not None
        made = rows_of(self.data, effect, place, shapes)
        if not scope:
            return made
        inside = {joint: self._inside(joint, scope)[:, None] for joint in candidate.lines}
        return [{joint: rows * inside[joint] for joint, rows in one.items()} for one in made]

    def made(self, effect: Effect, place: Place, shape: Shape) -> Columns | None:
        """Rows (r_j, w) that a candidate has of an effect in one shape; None where none has it."""
        for one in self.candidates:
            if one.effect is effect and one.place == place and shape in one.shapes:
                first = one.shapes.index(shape) * one.width
                lines = slice(first, first + one.width)
                return {joint: table[lines].T.astype(float) for joint, table in one.lines.items()}
        return None

    def _effects(self, effects: Sequence[Effect], kind: Kind) -> list[Candidate]:
        made = []
        for effect in effects:
            for place in effect.places(len(self.data.joints)):
                covered = self.data.covered[place.joint]
                hidden = (effect.name, place.joint) in self._hidden
                if hidden or cannot_show(effect, covered):
                    continue
                for branch in effect.branches(effect.grid(covered)):
                    made += self._of_shapes(kind, effect, place, list(branch))
        return made

    def _of_shapes(
        self, kind: Kind, effect: Effect, place: Place, shapes: Sequence[Shape]
    ) -> list[Candidate]:
        """Candidates of these shapes, one for each width; shapes without finite torque are out."""
        rows = rows_of(self.data, effect, place, shapes, np.float32)
        of_width: dict[int, list[int]] = {}
        for k, table in enumerate(rows):
            if all(np.abs(part).max(initial=0.0) < _LARGEST for part in table.values()):
                of_width.setdefault(width_of(table), []).append(k)
        return [
            Candidate(
                kind,
                effect,
                place,
                shapes=tuple(shapes[k] for k in chosen),
                changes=(),
                lines={
                    joint: np.concatenate([rows[k][joint].T for k in chosen], dtype=np.float32)
                    for joint in rows[0]
                },
                width=width,
            )
            for width, chosen in sorted(of_width.items())
        ]

    def _parametric(self, without: Collection[str], still: Collection[int]) -> list[Candidate]:
        units = change_rows(self.data, self.space)
        made = []
        for effect in (effect for effect in PARAMETRIC if effect.name not in without):
            for joint in effect.places(self.space):
                if joint in still or (effect.name, joint) in self._hidden:
                    continue
                place = None if joint is None else Place(joint)
                for changes in map(tuple, effect.variants(self.space, joint)):
                    lines, one = _lines(units, changes), (Shape(),)
                    made.append(
                        Candidate(Kind.NUMBER, effect, place, one, changes, lines, len(changes))
                    )
        return [candidate for candidate in made if candidate.lines]

    def why_impossible(
        self,
        candidate: Candidate,
        shape: Shape,
        coefficients: FloatArray,
        deviations: FloatArray,
    ) -> str:
        """Why no arm has these coefficients (w,); empty where one may have."""
        effect, place = candidate.effect, candidate.place
        if isinstance(effect, ParametricEffect):
            estimates = candidate.estimates(coefficients, deviations)
            fits = effect.admissible(self.space, candidate.key.joint, estimates)
            return "" if fits else "its numbers are those of no arm"
        assert place is not None
        if not effect.admissible(shape, coefficients):
            return "its numbers have a sign or size that physics excludes"
        return effect.impossible(shape, coefficients, self.data.covered[place.joint])


def _lines(units: Sequence[FloatArray], changes: Sequence[Change]) -> dict[int, SingleArray]:
    """Rows (w, r_j) of changes at the joints that they move; `units`: see `change_rows`."""
    directions = np.column_stack([change.direction for change in changes])
    tables = [(unit @ directions).T.astype(np.float32) for unit in units]
    return {joint: table for joint, table in enumerate(tables) if np.any(table)}


def change_rows(data: Baseline, space: ParameterSpace) -> tuple[FloatArray, ...]:
    """Rows (r_j, d) of unit changes of all numbers of a space, for each joint, N m."""
    b, units = data.regression.parameters, []
    # Per small rotation of gravity about each axis, N m/rad.
    down = data.prepared.model.robot.gravity
    gravity = unit_gravity_rows(data, np.array([np.cross(axis, down) for axis in space.axes]))
    for joint, rows in enumerate(data.rows):
        unit = np.zeros((len(rows), space.size))
        unit[:, rows.columns] = rows.matrix
        unit[:, b : b + 2] = gravity[joint]
        unit[:, b + 2 + joint] = rows.prediction(space.given)
        units.append(unit)
    return tuple(units)


def level_axes(gravity: FloatArray) -> FloatArray:
    """Two unit vectors (2, 3) at right angles to gravity, as near to x, y, z as they can be."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return np.eye(3)[:2]
    down = gravity / size
    kept = sorted(range(3), key=lambda axis: abs(down[axis]))[:2]
    first = np.eye(3)[min(kept)]
    first = first - (first @ down) * down
    first = first / np.linalg.norm(first)
    second = np.cross(down, first)
    return np.array([first, second if second[max(kept)] > 0.0 else -second])
