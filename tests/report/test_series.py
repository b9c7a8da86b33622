import numpy as np

from idim_iv_ros.report.series import contiguous_runs, thin
from idim_iv_ros.result import JointSeries


def _long(seconds: float = 3600.0, rate: float = 40.0) -> JointSeries:
    time = np.arange(int(seconds * rate)) / rate
    measured = np.sin(time)
    measured[77777] = 5.0
    return JointSeries("joint_1", time, measured, np.sin(time))


def test_an_hour_becomes_a_few_thousand_points_that_keep_the_peak() -> None:
    thinned = thin(_long())
    assert len(thinned.time) < 3000
    assert np.nanmax(thinned.measured) == 5.0
    assert np.nanmax(thinned.residual) > 3.9
    assert (thinned.time[0], thinned.time[-1]) == (0.0, _long().time[-1])


def test_a_short_series_is_kept_as_it_is() -> None:
    series = JointSeries("joint_1", np.arange(5) / 10, np.arange(5.0), np.zeros(5))
    thinned = thin(series)
    np.testing.assert_array_equal(thinned.measured, series.measured)
    assert len(thinned.gaps) == 0


def test_lines_are_interrupted_where_samples_do_not_count() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.6, 0.7])
    series = JointSeries("joint_1", time, np.arange(5.0), np.zeros(5))
    thinned = thin(series)
    np.testing.assert_array_equal(thinned.gaps, [[0.2, 0.6]])
    np.testing.assert_array_equal(thinned.measured, [0.0, 1.0, 2.0, np.nan, 3.0, 4.0])
    assert contiguous_runs(series) == [slice(0, 3), slice(3, 5)]
