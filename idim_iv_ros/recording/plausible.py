"""Values that no robot has: readings that were never measured, left out or refused with a place."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from idim_iv_ros.errors import DataError
from idim_iv_ros.types import BoolArray, FloatArray

# Beyond these a number is no position in rad or m, speed in rad/s or m/s; efforts may be counts.
LARGEST = {"position": 1e6, "velocity": 1e6, "effort": 1e9}
UNITS = {"position": " rad (or m)", "velocity": " rad/s (or m/s)", "effort": ""}
# Share of the samples that may be so wrong before the rest is not believed either.
_MOST = 0.01


@dataclass(frozen=True)
class WrongRows:
    """Samples that hold no plausible number.

    Attributes
    ----------
    rows : (k,) int
        Where, from 0.
    samples : int
        Of how many.
    joint : str
        A joint of the first one.
    value : float
        That value.
    limit : str
        What it should not exceed, with its unit.
    """

    rows: NDArray[np.int64]
    samples: int
    joint: str
    value: float
    limit: str

    @property
    def too_many(self) -> bool:
        """Whether the signal as a whole cannot be used."""
        return len(self.rows) > _MOST * self.samples

    def sentence(self, what: str, first: int) -> str:
        """Say which `what` (``row``, ``message``) are wrong, counted from `first`."""
        begin, end = int(self.rows[0]) + first, int(self.rows[-1]) + first
        why = "is not a number" if np.isnan(self.value) else f"is above {self.limit}"
        if len(self.rows) == 1:
            return f"{what} {begin} holds {self.value:.3g} for {self.joint}, which {why}"
        return (
            f"{len(self.rows)} of {self.samples} {what}s, the first {begin} and the last {end} "
            f"(counted from {first}), hold no possible value; {what} {begin} holds "
            f"{self.value:.3g} for {self.joint}, which {why}"
        )


def wrong_rows(
    name: str, values: FloatArray, joints: Sequence[str], *, missing: bool
) -> WrongRows | None:
    """Find the rows of `values` (n, n_joints) that cannot be a `name`; None for none.

    Parameters
    ----------
    name
        ``position``, ``velocity`` or ``effort``.
    values
    joints
        Of the columns.
    missing
        Whether a value that is missing (NaN) is wrong, too.
    """
    wrong = impossible(name, values)
    if missing:
        wrong = wrong | np.isnan(values)
    places = np.flatnonzero(wrong.any(axis=1))
    if len(places) == 0:
        return None
    row = int(places[0])
    column = int(np.argmax(wrong[row]))
    limit = f"{LARGEST[name]:g}{UNITS[name]}"
    return WrongRows(places, len(values), joints[column], float(values[row, column]), limit)


def impossible(name: str, values: FloatArray) -> BoolArray:
    """Mark infinite values and those beyond what a `name` can be."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) > LARGEST[name])


def without_impossible(
    name: str, values: FloatArray, joints: Sequence[str], where: str
) -> tuple[FloatArray, str]:
    """Values with NaN for what is impossible, and a sentence on it; as they are if nothing is.

    Raises
    ------
    DataError
        There are too many to believe the rest.
    """
    most = LARGEST[name]
    # The least and the greatest are found without a copy; NaN makes both of them NaN.
    if values.size == 0 or (values.min() >= -most and values.max() <= most):
        return values, ""
    found = wrong_rows(name, values, joints, missing=False)
    if found is None:
        return values, ""
    sentence = f"{name}: {found.sentence('message', 1)}"
    if found.too_many:
        raise DataError(f"{where}: {sentence}; look at the driver, its units and its byte order")
    return np.where(impossible(name, values), np.nan, values), f"{sentence}; left out"
