"""What changed between two identifications, beyond what noise explains."""

import numpy as np
import pytest

from idim_iv_ros.statistics.drift import drifts_of

NAMES = [f"p{k}" for k in range(20)]
Estimates = dict[str, tuple[float, float]]


def estimates(values: np.ndarray, std: float = 0.1) -> Estimates:
    return {name: (float(value), std) for name, value in zip(NAMES, values, strict=True)}


def test_statistic_is_difference_over_combined_deviation() -> None:
    first, last = np.ones(20), np.ones(20)
    last[3] += 2.0
    drifts = drifts_of(estimates(first, 0.3), estimates(last, 0.4), 0.01, ("a",))
    assert [drift.parameter for drift in drifts if drift.drifts] == ["p3"]
    assert drifts[3].statistic == pytest.approx(2.0 / 0.5)
    assert (drifts[3].first, drifts[3].value, drifts[3].since) == (1.0, 3.0, ("a",))


def test_unchanged_parameters_are_flagged_as_often_as_asked() -> None:
    random = np.random.default_rng(1)
    flagged = 0
    for _ in range(1000):
        first, last = (estimates(5.0 + 0.1 * random.standard_normal(20)) for _ in range(2))
        flagged += any(drift.drifts for drift in drifts_of(first, last, 0.1, ()))
    assert 70 <= flagged <= 130  # 100 ± 3 σ
