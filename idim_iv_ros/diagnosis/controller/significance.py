"""Whether numbers of a cause are known to differ from zero."""

import numpy as np
from scipy.stats import chi2

from idim_iv_ros.diagnosis import settings
from idim_iv_ros.types import FloatArray


def differs(value: float, std: float | None) -> bool:
    """Whether the 95 % interval of one number leaves out zero; not where it is not known."""
    return std is not None and abs(value) >= settings.NORMAL_95 * std


def together(values: FloatArray, covariance: FloatArray) -> float:
    """p-value of Wald's test that all numbers (k,) are zero."""
    deviations = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    standard = values / deviations
    scaled = covariance / np.outer(deviations, deviations)
    statistic = float(standard @ np.linalg.pinv(scaled, rcond=1e-9, hermitian=True) @ standard)
    return float(chi2.sf(statistic, len(values)))
