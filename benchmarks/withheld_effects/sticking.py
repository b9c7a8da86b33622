"""One implicit step of a mass with dry friction: joints that stick really stand still."""

import numpy as np
from numba import njit

SWEEPS = 60
CLOSE = 1e-10  # rad/s


@njit(cache=True)
def inverse(matrix: np.ndarray, out: np.ndarray) -> None:
    """Inverse of a symmetric positive definite matrix (n, n) by Gauss-Jordan, in place."""
    n = len(matrix)
    out[:] = 0.0
    for i in range(n):
        out[i, i] = 1.0
    for i in range(n):
        pivot = 1.0 / matrix[i, i]
        for k in range(n):
            matrix[i, k] *= pivot
            out[i, k] *= pivot
        for r in range(n):
            if r != i:
                factor = matrix[r, i]
                for k in range(n):
                    matrix[r, k] -= factor * matrix[i, k]
                    out[r, k] -= factor * out[i, k]


@njit(cache=True)
def stick_or_slip(
    mobility: np.ndarray,
    velocity: np.ndarray,
    direction: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    impulse: np.ndarray,
    moved: np.ndarray,
) -> None:
    """Friction impulses within their bounds that stop what they can; `velocity` in place.

    Projected Gauss-Seidel on the box-constrained complementarity problem of Moreau's
    time-stepping, started from the impulses of the step before.

    Parameters
    ----------
    mobility : (n, n) inverse of the effective mass
    velocity : (n,) in: without friction, out: with it
    direction : (rows, n) the velocity that each row resists
    lower, upper : (rows,) bounds of the impulses, N m s
    impulse : (rows,) in: first guess, out: solution
    moved : (rows, n) work space, mobility times direction
    """
    rows, n = direction.shape
    for r in range(rows):
        impulse[r] = min(max(impulse[r], lower[r]), upper[r])
        for i in range(n):
            moved[r, i] = 0.0
            for k in range(n):
                moved[r, i] += mobility[i, k] * direction[r, k]
        for i in range(n):
            velocity[i] += moved[r, i] * impulse[r]
    for _ in range(SWEEPS):
        change = 0.0
        for r in range(rows):
            slip, softness = 0.0, 0.0
            for i in range(n):
                slip += direction[r, i] * velocity[i]
                softness += direction[r, i] * moved[r, i]
            new = min(max(impulse[r] - slip / softness, lower[r]), upper[r])
            step = new - impulse[r]
            if step != 0.0:
                impulse[r] = new
                for i in range(n):
                    velocity[i] += moved[r, i] * step
                change = max(change, abs(step) * softness)
        if change < CLOSE:
            break
