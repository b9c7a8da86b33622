import numpy as np

from idim_iv_ros.identification.result import JointSeries
from idim_iv_ros.recording import SessionPart
from idim_iv_ros.report.time_axis import Curves, SessionAxis, curves, session_axis

ALONE = session_axis([])


def _thin(series: JointSeries, session: SessionAxis) -> Curves:
    """Measured, predicted and residual."""
    residual = series.measured - series.predicted
    values = (series.measured, series.predicted, residual)
    return curves(series.time, values, session, peaks_of=(series.measured, residual), buckets=700)


def _long(seconds: float = 3600.0, rate: float = 40.0) -> JointSeries:
    time = np.arange(int(seconds * rate)) / rate
    measured = np.sin(time)
    measured[77777] = 5.0
    return JointSeries("joint_1", time, measured, np.sin(time))


def test_an_hour_becomes_a_few_thousand_points_that_keep_the_peak() -> None:
    thinned = _thin(_long(), ALONE)
    assert len(thinned.time) < 3000
    assert np.nanmax(thinned.values[0]) == 5.0
    assert np.nanmax(thinned.values[2]) > 3.9
    assert (thinned.time[0], thinned.time[-1]) == (0.0, _long().time[-1])


def test_a_short_series_is_kept_as_it_is() -> None:
    series = JointSeries("joint_1", np.arange(5) / 10, np.arange(5.0), np.zeros(5))
    thinned = _thin(series, ALONE)
    np.testing.assert_array_equal(thinned.values[0], series.measured)
    assert len(thinned.gaps) == 0


def test_lines_are_interrupted_where_samples_do_not_count() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.6, 0.7])
    series = JointSeries("joint_1", time, np.arange(5.0), np.zeros(5))
    thinned = _thin(series, ALONE)
    np.testing.assert_array_equal(thinned.gaps, [[0.2, 0.6]])
    np.testing.assert_array_equal(thinned.values[0], [0.0, 1.0, 2.0, np.nan, 3.0, 4.0])


TWO = session_axis([SessionPart("run1", 0.0, 1.0), SessionPart("run2", 1.01, 1.0)])


def _two(pause: float = 0.0) -> JointSeries:
    """A hundred rows a second in two recordings, with no row left out in between."""
    time = np.arange(202) / 100.0
    time[101:] += pause
    return JointSeries("joint_1", time, np.sin(time), np.zeros(202))


def test_no_line_runs_from_one_recording_to_the_next() -> None:
    thinned = _thin(_two(), TWO)
    breaks = np.flatnonzero(np.isnan(thinned.values[0]))
    assert list(breaks) == [101]
    assert np.isnan(thinned.values[1][101])
    assert len(thinned.gaps) == 0  # nothing was left out between the two


def test_a_long_pause_does_not_leave_hairlines_for_recordings() -> None:
    parts = [SessionPart("run1", 0.0, 1.0), SessionPart("run2", 601.0, 1.0)]
    session = session_axis(parts)
    thinned = _thin(_two(pause=599.99), session)
    time = thinned.time[np.isfinite(thinned.time)]
    assert np.all(np.diff(time) > 0.0)
    assert 2.0 < time[-1] < 2.1
    marks = session.marks()
    assert [note["text"] for note in marks["annotations"]] == ["1", "2"]
    assert len(marks["shapes"]) == 1
    assert session.words.endswith("1 run1, 2 run2.")
