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
    """Logarithm of the Bayes factor of each size, (k, sizes), from z, λ (k, w) and τ₀² (k,)."""
    information = information[:, None, :]
    least = 1.0 + misfit[:, None, None] * information
    whole = least + SIZES[:, None] ** 2 * information
    squares = scores[:, None, :] ** 2
    gains = squares * (1.0 / least - 1.0 / whole) - np.log(whole / least)
    return np.asarray(0.5 * gains.sum(axis=2))


def log_bayes_factor(scores: FloatArray, information: FloatArray, misfit: FloatArray) -> FloatArray:
    """The mean over sizes, (k,)."""
    of_size = by_size(scores, information, misfit)
    top = of_size.max(axis=1)
    return np.asarray(top + np.log(np.mean(np.exp(of_size - top[:, None]), axis=1)))


def shrunk(scores: FloatArray, information: FloatArray) -> FloatArray:
    """Factors (k, w), 0 to 1, by which the prior of its size draws scores (k, w) to zero."""
    logs = by_size(scores, information, np.zeros(len(scores)))
    weights = np.exp(logs - logs.max(axis=1, keepdims=True))
    variance = (weights @ SIZES**2 / weights.sum(axis=1))[:, None] * information
    return np.asarray(variance / (1.0 + variance))
