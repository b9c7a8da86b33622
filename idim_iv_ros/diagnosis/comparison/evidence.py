"""Bayes factors of candidates whose coefficients have a physical size.

A coefficient vector in its own eigenbasis has scores z and information λ. Under a size τ its
variance is τ², and the logarithm of the Bayes factor against a size τ₀ is

Σ ½ [z² (1/a − 1/b) − ln(b/a)],   a = 1 + τ₀² λ,   b = 1 + (τ₀² + τ²) λ,

averaged over what τ may be.
"""

import numpy as np

from idim_iv_ros.types import FloatArray

# Torque that an effect may have, as a share of the joint's: its size is a mixture over these.
SIZES = np.array([0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64])


def by_size(scores: FloatArray, information: FloatArray, misfit: FloatArray) -> FloatArray:
    """Logarithm of the Bayes factor of each size: (k, sizes).

    Parameters
    ----------
    scores, information
        (k, w) z and λ.
    misfit
        (k,) τ₀².
    """
    small = misfit[:, None]
    least = 1.0 + small * information
    made = []
    for size in SIZES:
        whole = 1.0 + (small + size**2) * information
        made.append(
            np.sum(
                0.5 * scores**2 * (1.0 / least - 1.0 / whole) - 0.5 * np.log(whole / least), axis=1
            )
        )
    return np.stack(made, axis=1)


def log_bayes_factor(scores: FloatArray, information: FloatArray, misfit: FloatArray) -> FloatArray:
    """The mean over sizes, (k,)."""
    of_size = by_size(scores, information, misfit)
    top = of_size.max(axis=1)
    return np.asarray(top + np.log(np.mean(np.exp(of_size - top[:, None]), axis=1)))


def shrunk(scores: FloatArray, information: FloatArray, misfit: float) -> FloatArray:
    """Factors (w,), 0 to 1, by which the prior of its size draws one option's scores to zero."""
    logs = by_size(scores[None], information[None], np.array([misfit]))[0]
    weights = np.exp(logs - logs.max())
    variance = (misfit + float(weights @ SIZES**2) / float(weights.sum())) * information
    return np.asarray(variance / (1.0 + variance))
