import re
from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.diagnosis.result import GapResult, NotTestable, Where
from idim_iv_ros.report import gap_report_html
from tests.report.sample_gap import Case, sample_gap
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


def test_a_given_model_that_is_wrong_is_drawn_only_where_numbers_are_the_cause() -> None:
    def rows(case: Case) -> str:
        page = _page(sample_gap(2, case))
        labels = [a.get("aria-label") or "" for _, a in page.elements]
        return next(label for label in labels if label.startswith("Residual of joint_2"))

    assert rows("structural").endswith("refit, extended")
    assert rows("parametric").endswith("nominal, refit")
    assert rows("both").endswith("nominal, refit, extended")


def test_with_many_joints_only_residuals_of_those_with_causes_are_unfolded() -> None:
    page = _page(sample_gap(6, "structural"))
    folds = [attrs for name, attrs in page.elements if name == "details"]
    assert sum("open" in attrs for attrs in folds if attrs.get("class") == "plot") == 2


def test_joints_that_cannot_be_tested_for_the_same_reason_share_a_row() -> None:
    result = sample_gap(6, "none")
    refused = [NotTestable("backlash", joint, "too slow", "creep") for joint in result.joints]
    text = _page(replace(result, not_testable=tuple(refused))).text
    assert "joint_1, joint_2, joint_3, joint_4, joint_5, joint_6" in text
    assert text.count("Too slow.") == 1


def test_hours_of_many_joints_stay_a_small_file() -> None:
    short = len(gap_report_html(sample_gap(6, "both", seconds=60.0)))
    long = len(gap_report_html(sample_gap(6, "both", seconds=3600.0)))
    assert long < 1.15 * short
    assert long < 3_000_000


def test_a_prismatic_joint_has_newtons_and_millimetres() -> None:
    result = replace(sample_gap(2, "structural"), joint_types=("prismatic", "revolute"))
    page = _page(result)
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
