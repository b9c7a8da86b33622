"""The page of a diagnosis, and the words and figures in it."""

import base64
import re
from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.diagnosis.result.document import GapResult, Where
from idim_iv_ros.excitation.segments import separating_motion
from idim_iv_ros.report.figures import typed
from idim_iv_ros.report.page import gap_report_html
from idim_iv_ros.report.sections.torque import tracking_figure
from tests.report.sample_gap import sample_gap
from tests.report.test_html import Page


def _page(result: GapResult) -> Page:
    return Page(gap_report_html(result))


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("floor", [False, True])
@pytest.mark.parametrize("tracking", [False, True])
def test_what_is_unknown_is_left_out_or_said(given: bool, floor: bool, tracking: bool) -> None:
    text = gap_report_html(sample_gap(2, "both", given=given, floor=floor, tracking=tracking))
    page = Page(text)
    assert ('<th scope="row">nominal model</th>' in text) == given
    assert ("<small>unknown</small>" in text) == (not floor)
    assert ("Tracking error in closed loop" in page.text) == tracking
    assert "nan" not in page.text.split()


def test_a_cause_shows_its_numbers_and_what_it_is_mistaken_for() -> None:
    text = _page(sample_gap(2, "structural")).text
    for words in (
        *("Stribeck at joint_2", "1.62±", "0.121±", "0.620", "0.225", "6 of 6", "47"),
        *("presliding at joint_2", "weight 30", "18.020±"),
    ):
        assert words in text.replace("\N{NARROW NO-BREAK SPACE}", "").replace(" ±", "±"), words
    assert re.search(r"removes 96.% \(90 to 100 %\) of the gap above the noise floor", text)


def test_hours_of_many_joints_stay_a_small_file() -> None:
    short = len(gap_report_html(sample_gap(6, "both", seconds=60.0)))
    long = len(gap_report_html(sample_gap(6, "both", seconds=3600.0)))
    assert long < 1.15 * short
    assert long < 3_000_000


def test_a_prismatic_joint_has_newtons_and_millimetres() -> None:
    page = _page(replace(sample_gap(2, "structural"), joint_types=("prismatic", "revolute")))
    assert {"Torque, N", "Torque, N m", "Tracking, mm", "Tracking, mrad"} <= set(page.words)


def test_a_joint_that_stands_still_or_has_no_rows_is_no_error() -> None:
    result = sample_gap(2, "structural")
    rows = np.zeros_like(result.series[0].speed)
    still = replace(result.series[0], speed=rows, position=rows, since_reversal=rows)
    columns = [name for name in vars(still) if name not in ("joint", "step")]
    empty = replace(result.series[1], **dict.fromkeys(columns, np.zeros(0)))
    page = _page(replace(result, series=(still, empty)))
    assert page.open == []
    assert "nan" not in page.text


def test_the_simulation_gap_is_drawn_by_itself_in_its_own_unit() -> None:
    series = sample_gap(2, "structural").tracking[0]
    traces = tracking_figure(series, "mrad").data
    assert [trace.get("yaxis") for trace in traces] == [None, "y2", None, "y2", None]
    assert traces[-1]["hovertemplate"].startswith("robot")
    largest = 1e3 * np.abs(series.measured - series.before).max()
    lines = tracking_figure(replace(series, after=None), "mrad").data
    assert [trace.get("yaxis") for trace in lines] == [None, "y2", None]
    assert "before − robot" in lines[1]["hovertemplate"]
    assert np.abs(_numbers(lines[1]["y"])).max() == pytest.approx(largest, rel=1e-4)


def test_packed_numbers_are_finer_than_a_screen_and_keep_their_breaks() -> None:
    values = np.concatenate([np.linspace(-3.0, 7.0, 1001), [np.nan, 0.125]])
    unpacked = _numbers(typed(values))
    assert list(np.flatnonzero(np.isnan(unpacked))) == [1001]
    np.testing.assert_allclose(unpacked, values, atol=10.0 / 65000.0)
    np.testing.assert_array_equal(_numbers(typed(np.full(3, 2.5))), np.full(3, 2.5))
    assert len(_numbers(typed(np.zeros(0)))) == 0


def _numbers(packed: dict) -> np.ndarray:
    """What the page's script makes of packed numbers."""
    levels = np.frombuffer(base64.b64decode(packed["levels"]), dtype="<u2")
    return np.where(levels == 65535, np.nan, packed["low"] + packed["step"] * levels)


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        (("stribeck", "presliding"), "creep and reversals"),
        (("torque_gain", "payload"), "of known mass"),
        (("elasticity", "time_delay"), "multisine"),  # segments that reveal both are named
        (("payload", "link_inertia"), "take it off"),
        (("link_inertia", "payload"), "take it off"),
        (("position_ripple", "gain_ripple"), "under another load"),
    ],
)
def test_motions_that_separate_two_effects(pair: tuple[str, str], words: str) -> None:
    assert words in separating_motion(*pair)
    assert separating_motion("not", "known") == ""


def test_a_diagnosis_that_could_do_nothing_still_has_its_page() -> None:
    result = replace(
        sample_gap(2, "unknown"),
        where=Where((), ()),
        findings=(),
        not_testable=(),
        stages=(),
        series=(),
        tracking=(),
        unexplained=None,
        extended_parameters={},
        timing={},
    )
    page = _page(result)
    assert page.open == []
    assert page.figures == []
    assert result.summary in page.text
