"""Effects of the catalogue that act in one set of recordings only.

An effect that both sets have enters with common coefficients. One that appears in the second set is
an effect of that set alone, and one that vanishes an effect of the reference alone: so no
coefficient needs to be negative, and what physics allows of an effect holds for a change of it.
"""

from collections.abc import Sequence
from copy import copy
from typing import Any, Literal

import numpy as np

from idim_iv_ros.diagnosis.refit.smooth_motion import SmoothMotion
from idim_iv_ros.diagnosis.structural.likelihood import Columns
from idim_iv_ros.effects.effect import Effect, Place, Shape
from idim_iv_ros.effects.motion import RobotMotion
from idim_iv_ros.types import BoolArray, FloatArray

Scope = Literal["both", "reference", "against"]
GridKey = tuple[str, Place, tuple[Shape, ...]]

_SEPARATOR = " in "


def only_in(effect: Effect, scope: Scope, motions: Sequence[SmoothMotion]) -> Effect:
    """Return the effect with columns that are zero outside these motions.

    Its name says so, and its confounders are those of the same set.
    """
    own = copy(effect)
    inside = {id(motion) for motion in motions}

    def columns(motion: RobotMotion, place: Place, shape: Shape) -> dict[int, FloatArray]:
        made = effect.columns(motion, place, shape)
        if id(motion) in inside:
            return made
        return {joint: np.zeros_like(rows) for joint, rows in made.items()}

    vars(own).update(
        columns=columns,
        name=scoped_name(effect.name, scope),
        confounders=tuple(scoped_name(name, scope) for name in effect.confounders),
    )
    return own


class ScopedGrids(dict[GridKey, list[Columns]]):
    """Rows of grids, made once for both sets: those of one set are the same, masked.

    Parameters
    ----------
    inside : sequence of (r_j,) bool
        Rows of the second set, for each joint.
    """

    def __init__(self, inside: Sequence[BoolArray]) -> None:
        super().__init__()
        self._inside = inside

    def __contains__(self, key: object) -> bool:
        return super().__contains__(_plain(key))

    def __getitem__(self, key: GridKey) -> list[Columns]:
        """Rows of each shape."""
        whole, scope = super().__getitem__(_plain(key)), scope_of(key[0])
        if scope == "both":
            return whole
        wanted = scope == "against"
        return [
            {
                joint: np.where((self._inside[joint] == wanted)[:, None], rows, 0.0)
                for joint, rows in columns.items()
            }
            for columns in whole
        ]


def _plain(key: Any) -> GridKey:
    name, place, shapes = key
    return plain_name(name), place, shapes


def scoped_name(name: str, scope: Scope) -> str:
    """Name of an effect in one set."""
    return name if scope == "both" else f"{name}{_SEPARATOR}{scope}"


def plain_name(name: str) -> str:
    """Name of the catalogue."""
    return name.partition(_SEPARATOR)[0] if scope_of(name) != "both" else name


def scope_of(name: str) -> Scope:
    """Set in which an effect of this name acts."""
    if name.endswith(f"{_SEPARATOR}reference"):
        return "reference"
    return "against" if name.endswith(f"{_SEPARATOR}against") else "both"
