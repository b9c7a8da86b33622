"""How far instruments are from valid, apart from whether the deviation is significant."""

import numpy as np

from idim_iv_ros.statistics.basis import independent_basis
from idim_iv_ros.types import FloatArray

LARGEST_STANDARD_ERROR = 0.05


def largest_deviation(reduced: FloatArray, n_rows: int) -> float | None:
    """Largest |Π̂ − I| without units, over the entries that the rows determine.

    Π̂ is the least squares estimate; entry (k, i) is scaled by rms(Z_k)/rms(X_i), so that it is
    what of column i, in parts of its rms, goes with column k beyond Π = I. Entries whose
    standard error (taken as if rows were white) exceeds 0.05 are left out; None if all do.

    Parameters
    ----------
    reduced : (k, 2c)
        Triangle of [Z X].
    n_rows : int
        How many rows it was made of.
    """
    width = reduced.shape[1] // 2
    instruments, regressor = reduced[:, :width], reduced[:, width:]
    basis = independent_basis(instruments)
    seen = np.flatnonzero(np.linalg.norm(regressor, axis=0) > 0.0)
    dof = n_rows - basis.rank
    if basis.rank == 0 or len(seen) == 0 or dof <= 0:
        return None
    regressor, kept = regressor[:, seen], basis.kept
    to_unit = np.linalg.norm(instruments[:, kept], axis=0)[:, None] / np.linalg.norm(
        regressor, axis=0
    )
    difference = basis.solve(regressor - instruments[:, seen], width)[kept]
    spread_of_row = np.linalg.norm(np.linalg.inv(basis.upper), axis=1)
    noise = np.linalg.norm(basis.remove(regressor), axis=0) / np.sqrt(dof)
    entries = np.abs(difference) * to_unit
    determined = np.outer(spread_of_row, noise) * to_unit <= LARGEST_STANDARD_ERROR
    return float(entries[determined].max()) if determined.any() else None


def torque_deviation(
    coefficients: FloatArray, covariance_root: FloatArray, instruments: FloatArray
) -> float:
    """‖Z δ̂‖² less its expectation under δ = 0, at least 0, in N² m².

    Parameters
    ----------
    coefficients : (c,)
        δ̂ of (X − Z) β̂ = Z δ + v.
    covariance_root : (c, k)
        covariance_root @ covariance_root.T is the covariance of δ̂.
    instruments : (r, c)
        Unfiltered.
    """
    explained = instruments @ coefficients
    by_noise = instruments @ covariance_root
    return max(0.0, float(explained @ explained) - float(np.vdot(by_noise, by_noise)))
