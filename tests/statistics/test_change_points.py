"""Changes over time: right size under no change, right date and size where there is one."""

import numpy as np
import pytest
import scipy
import statsmodels.api as sm

from idim_iv_ros.statistics.change_points import change_of
from idim_iv_ros.statistics.hypothesis import drifts_of

BAGS = 14
TIMES = np.cumsum(np.random.default_rng(9).uniform(1.0, 9.0, BAGS))


def series(seed: int, change: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values with noise of unequal variances, three times as large as they say."""
    random = np.random.default_rng(seed)
    variances = random.uniform(0.5, 2.0, BAGS)
    return 100.0 + change + 3.0 * np.sqrt(variances) * random.normal(size=BAGS), variances


@pytest.mark.parametrize("prior", [0.0, 8.0])
def test_without_a_change_the_p_value_is_uniform(prior: float) -> None:
    """Also where the scatter is half known: the variances are right up to a chi-square of 8."""
    random, p_values = np.random.default_rng(7), []
    for seed in range(300):
        values, variances = series(seed, np.zeros(BAGS))
        if prior:
            values = np.sqrt(prior / random.chisquare(prior)) * (values - 100.0) / 3.0
        p_values.append(change_of(values, variances, TIMES, prior).p_value)
    for level in (0.01, 0.05, 0.1):
        few = np.sum(np.array(p_values) <= level)
        assert few <= scipy.stats.binom.ppf(0.999, 300, level)
        assert few >= scipy.stats.binom.ppf(0.001, 300, level)


@pytest.mark.parametrize("kind", ["step", "ramp"])
def test_a_change_is_found_with_its_date_and_size(kind: str) -> None:
    place = 8
    shape = np.zeros(BAGS)
    if kind == "step":
        shape[place:] = 30.0
    else:
        shape[place - 1 :] = 50.0 * (TIMES[place - 1 :] - TIMES[place - 1])
        shape[place - 1 :] /= TIMES[-1] - TIMES[place - 1]
    dates = sizes = 0
    for seed in range(40):
        change = change_of(*series(seed, shape), TIMES)
        assert change is not None and change.p_value < 1e-3 and change.kind == kind
        assert abs(change.place - place) <= 2
        dates += change.place_low <= place <= change.place_high
        sizes += change.size_low <= shape[-1] <= change.size_high
    assert dates >= 34 and sizes >= 34


def test_level_and_size_are_those_of_weighted_least_squares() -> None:
    shape = np.where(np.arange(BAGS) >= 5, 40.0, 0.0)
    values, variances = series(1, shape)
    change = change_of(values, variances, TIMES)
    assert change is not None and change.place == change.place_low == change.place_high == 5
    columns = sm.add_constant((shape > 0).astype(float))
    theirs = sm.WLS(values, columns, weights=1.0 / variances).fit()
    assert (change.before, change.size) == pytest.approx(tuple(theirs.params))
    assert change.before_std == pytest.approx(theirs.bse[0])
    assert (change.size_low, change.size_high) == pytest.approx(tuple(theirs.conf_int()[1]))


def test_one_odd_value_is_no_change() -> None:
    values, variances = series(4, np.zeros(BAGS))
    values[6] += 60.0
    change = change_of(values, variances, TIMES)
    assert change is not None and change.p_value > 0.05


@pytest.mark.parametrize("count", [0, 1, 4])
def test_few_values_are_not_judged(count: int) -> None:
    assert change_of(np.arange(count) * 1.0, np.ones(count), np.arange(count) * 1.0) is None


def test_a_change_begins_where_a_time_does() -> None:
    """Bags with dates by the day: within a day their order means nothing."""
    values = np.array([0.0, 0.1, 0.2, 5.0, 5.1, 5.2, 5.1, 5.0])
    days = np.repeat([0.0, 30.0], 4)
    with np.errstate(all="raise"):
        change = change_of(values, np.ones(8), days)
    assert change is not None and change.kind == "step"
    assert (change.place, change.place_low, change.place_high) == (4, 4, 4)
    assert change.before == pytest.approx(np.mean(values[:4]))
    three = change_of(values, np.ones(8), np.repeat([0.0, 1.0, 30.0], [3, 2, 3]))
    assert three is not None and three.place == 3
    # Where only the first value is apart in time, no step is possible that has two on each side.
    late = change_of(values, np.ones(8), np.array([0.0, *[9.0] * 7]))
    assert late is None or late.place == 1


NAMES = [f"p{k}" for k in range(20)]
Estimates = dict[str, tuple[float, float]]


def estimates(values: np.ndarray, std: float = 0.1) -> Estimates:
    return {name: (float(value), std) for name, value in zip(NAMES, values, strict=True)}


def test_statistic_is_difference_over_combined_deviation() -> None:
    first, last = np.ones(20), np.ones(20)
    last[3] += 2.0
    drifts = drifts_of(estimates(first, 0.3), estimates(last, 0.4), 0.01)
    assert [drift.name for drift in drifts if drift.drifts] == ["p3"]
    assert drifts[3].statistic == pytest.approx(2.0 / 0.5)
    assert (drifts[3].before, drifts[3].now) == (1.0, 3.0)


def test_unchanged_parameters_are_flagged_as_often_as_asked() -> None:
    random = np.random.default_rng(1)
    flagged = 0
    for _ in range(1000):
        first, last = (estimates(5.0 + 0.1 * random.standard_normal(20)) for _ in range(2))
        flagged += any(drift.drifts for drift in drifts_of(first, last, 0.1))
    assert 70 <= flagged <= 130  # 100 ± 3 σ
