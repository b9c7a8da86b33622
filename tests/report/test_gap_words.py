"""What an engineer reads in the report of a diagnosis."""

import base64
from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.diagnosis.result import EffectParameter
from idim_iv_ros.excitation.segments import separating_motion
from idim_iv_ros.report import gap_report_html
from idim_iv_ros.report.figures import typed
from idim_iv_ros.report.sections.torque import tracking_figure
from tests.report.sample_gap import sample_gap
from tests.report.test_html import Page


def test_the_simulation_gap_is_drawn_by_itself_in_its_own_unit() -> None:
    series = sample_gap(2, "structural").tracking[0]
    assert series.before is not None
    assert series.after is not None
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


def test_a_parameter_without_interval_is_explained() -> None:
    result = sample_gap(2, "structural")
    first = result.causes[0]
    grid = replace(first, parameters={"speed": EffectParameter(0.12, None, "rad/s")})
    assert "Without ±" not in Page(gap_report_html(result)).text
    assert "Without ±" in Page(gap_report_html(replace(result, causes=(grid,)))).text


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
