"""Whether numbers of a cause are known to differ from zero."""

import numpy as np
from scipy.stats import chi2

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.types import FloatArray


def differs(value: float, std: float | None) -> bool:
    """Whether the 95 % interval of one number leaves out zero; not where it is not known."""
    return std is not None and abs(value) >= settings.NORMAL_95 * std


def any_differs(values: FloatArray, covariance: FloatArray) -> bool:
    """Whether numbers (k,) differ from zero: together by Wald's test, and at least one alone.

    Collinear numbers may fit well together while each of them may be anything: they say nothing.
    Of many, one alone may leave out zero by chance.
    """
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    if not any(differs(value, std) for value, std in zip(values, deviations, strict=True)):
        return False
    return together(values, covariance) <= settings.SIGNIFICANCE_LEVEL


def together(values: FloatArray, covariance: FloatArray) -> float:
    """p-value of Wald's test that all numbers (k,) are zero."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    standard = values / deviations
    scaled = covariance / np.outer(deviations, deviations)
    statistic = float(standard @ np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ standard)
    return float(chi2.sf(statistic, len(values)))
