"""Values that no robot has: readings that were never measured, left out or refused with a place."""

from collections.abc import Sequence

import numpy as np

from idim_iv_ros.errors import DataError
from idim_iv_ros.types import FloatArray

# Beyond these a number is no position in rad or m, speed in rad/s or m/s; efforts may be counts.
LARGEST = {"position": 1e6, "velocity": 1e6, "effort": 1e9}
_UNITS = {"position": " rad (or m)", "velocity": " rad/s (or m/s)", "effort": ""}
# Share of the samples that may be so wrong before the rest is not believed either.
_MOST = 0.01


def without_impossible(
    name: str,
    values: FloatArray,
    joints: Sequence[str],
    where: str,
    advice: str,
    *,
    row: str = "message",
    first: int = 1,
    missing: bool = False,
) -> tuple[FloatArray, str]:
    """Values with NaN for what is impossible, and a sentence on it; as they are if nothing is.

    `name`: ``position``, ``velocity`` or ``effort``. `values`: (n, n_joints). `joints`: of the
    columns. `where`, `advice`: beginning and end of the error. `row`, `first`: what a row is
    called, and the number of the first one. `missing`: whether a value that is missing (NaN) is
    wrong, too.
    Raises DataError: there are too many to believe the rest.
    """
    most = LARGEST[name]
    # The least and the greatest are found without a copy; NaN makes both of them NaN.
    if values.size == 0 or (values.min() >= -most and values.max() <= most):
        return values, ""
    with np.errstate(invalid="ignore"):
        wrong = np.abs(values) > most
    if missing:
        wrong |= np.isnan(values)
    rows = np.flatnonzero(wrong.any(axis=1))
    if len(rows) == 0:
        return values, ""
    column = int(np.argmax(wrong[rows[0]]))
    value = float(values[rows[0], column])
    why = "is not a number" if np.isnan(value) else f"is above {most:g}{_UNITS[name]}"
    begin, end = int(rows[0]) + first, int(rows[-1]) + first
    sentence = f"{row} {begin} holds {value:.3g} for {joints[column]}, which {why}"
    if len(rows) > 1:
        sentence = (
            f"{len(rows)} of {len(values)} {row}s, the first {begin} and the last {end} (counted "
            f"from {first}), hold no possible value; {sentence}"
        )
    if len(rows) > _MOST * len(values):
        raise DataError(f"{where}: {name}: {sentence}; {advice}")
    return np.where(wrong, np.nan, values), f"{name}: {sentence}"
