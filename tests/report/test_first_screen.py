"""What a reader sees first: two short sentences, what to do, and the robot."""

import re
from dataclasses import replace

import pytest

from idim_iv_ros.configuration import load_configuration
from idim_iv_ros.diagnosis.result.causes import ParameterError
from idim_iv_ros.diagnosis.result.document import GapResult
from idim_iv_ros.diagnosis.result.recordings import Difference, RecordingAgreement
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.report.advice import (
    contrast_steps,
    diagnosis_headline,
    diagnosis_steps,
    difference_rows,
    export_options,
    identification_headline,
    identification_steps,
)
from idim_iv_ros.report.gap_words import lacking_row, wrong_numbers
from idim_iv_ros.report.numerals import THIN, percent
from idim_iv_ros.report.page import gap_report_html
from idim_iv_ros.report.section import Files, Report
from tests.report.sample_gap import CASES, Case, sample_contrast, sample_gap
from tests.report.sample_result import sample_result
from tests.report.test_html import CASES as KINDS
from tests.report.test_html import Page

ARM6 = load_configuration("config/arm6.yaml").model_dump(mode="json", exclude_none=True)


def _arm6(case: Case = "both") -> GapResult:
    return replace(sample_gap(6, case), configuration=ARM6)


def _words(sentences: tuple[str, str]) -> int:
    return len(" ".join(sentences).split())


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("given", [False, True])
def test_the_verdict_of_a_diagnosis_is_short(case: Case, given: bool) -> None:
    result = sample_gap(6, case, given=given)
    # The longest name of the catalogue.
    longest = [
        replace(cause, effect="position_dependent_friction", joint="joint_6")
        for cause in result.causes
    ]
    headline = diagnosis_headline(replace(result, causes=tuple(longest)))
    assert _words(headline) <= 42
    assert all(sentence.endswith(".") for sentence in headline)


@pytest.mark.parametrize("case", CASES)
def test_a_diagnosis_ends_in_two_or_three_steps_the_last_one_a_recording(case: Case) -> None:
    steps = diagnosis_steps(Report(_arm6(case), Files("arm6.yaml")))
    assert 2 <= len(steps) <= 3
    assert all(step.words and step.code for step in steps)
    assert re.match(r"idim-iv (excite|record) .*--config arm6\.yaml", steps[-1].code)


@pytest.mark.parametrize("case", KINDS)
def test_an_identification_has_a_short_verdict_and_two_or_three_steps(case) -> None:
    for joints in (1, 7):
        result = sample_result(joints, case)
        assert _words(identification_headline(result)) <= 40
        steps = identification_steps(Report(result, Files("tx40.yaml")))
        assert 2 <= len(steps) <= 3
        assert any("--config tx40.yaml" in step.code for step in steps)


@pytest.mark.parametrize("left_out", [True, False])
def test_recordings_that_differ_come_before_any_cause(left_out: bool) -> None:
    level = Difference("friction_level", "joint_2", {"change": EffectParameter(1.0, 0.1, "N m")})
    alike = [RecordingAgreement(bag, True, "joint_1", 0.0) for bag in ("a.mcap", "b.mcap")]
    apart = RecordingAgreement("odd.mcap", False, "joint_2", 0.12, (level,))
    bags = ("a.mcap", "b.mcap") if left_out else ("a.mcap", "b.mcap", "odd.mcap")
    result = replace(_arm6(), bags=bags, recordings=(*alike, apart))
    first, rest, *others = diagnosis_headline(result)
    assert all(words in first for words in ("odd.mcap", "12", "joint_2", "friction level"))
    assert _words((first, rest)) <= 35
    assert ("means" in rest) == (not left_out)
    assert tuple(others) == diagnosis_headline(replace(result, recordings=()))
    (row,) = difference_rows(result)
    assert row[:2] == ("odd.mcap", "friction level at joint_2") and "1.0" in row[2]
    assert all(words in Page(gap_report_html(result)).text for words in row[:2])
    codes = [step.code for step in diagnosis_steps(Report(result, Files("arm6.yaml")))]
    line = "idim-iv diagnose a.mcap b.mcap --against odd.mcap --config arm6.yaml --out changes"
    assert (line in codes) == left_out


@pytest.mark.parametrize(
    ("differs", "bags", "out"), [(True, "x/b1 x/b2", "after"), (False, "a x/b1 x/b2", "both")]
)
def test_what_changed_ends_in_a_diagnosis(differs: bool, bags: str, out: str) -> None:
    contrast = sample_contrast().contrast
    files = Files("arm2.yaml", bags=("x/b1", "x/b2"))
    steps = contrast_steps(replace(contrast, differs=differs), files)
    assert steps[0].code == f"idim-iv diagnose {bags} --config arm2.yaml --out {out}"


@pytest.mark.parametrize("case", ["structural", "parametric", "both"])
def test_causes_go_into_the_simulator_by_one_command(case: Case) -> None:
    """Commands name the files where they lie."""
    files = Files("arm6.yaml", "out/why", ("data/a.mcap", "x/b.mcap", "y/b.mcap"))
    steps = diagnosis_steps(Report(_arm6(case), files))
    assert steps[0].code == "idim-iv export out/why/gap.json --config arm6.yaml --out simulator"
    assert files.recordings(["a.mcap", "b.mcap"]) == ["data/a.mcap", "b.mcap"]
    law = replace(_arm6("structural").causes[0], effect="controller_mismatch")
    steps = diagnosis_steps(Report(replace(_arm6(case), causes=(law,)), Files("arm6.yaml")))
    assert "export" not in steps[0].code
    assert "arm6.yaml" in steps[0].words


@pytest.mark.parametrize("case", CASES)
def test_the_first_screen_lists_what_the_simulator_lacks_and_counts_wrong_numbers(case) -> None:
    result = _arm6(case)
    rows = [lacking_row(result, cause) for cause in result.causes if cause.kind == "structural"]
    shown = Page(gap_report_html(result)).text
    for effect, sizes, share, probable, _ in rows:
        for text in (effect, sizes, share, probable):
            assert text.replace(THIN, " ") in shown.replace(THIN, " ")
    wrong = wrong_numbers(result)
    count = sum(cause.kind == "parametric" for cause in result.causes)
    assert wrong.startswith(f"{count} error") if count else wrong == ""
    assert wrong.replace(THIN, " ") in shown.replace(THIN, " ")


def test_the_page_draws_the_robot_with_the_share_of_each_joint() -> None:
    result = _arm6()
    page = Page(gap_report_html(result))
    text = page.text.replace(THIN, " ")
    circles = [attributes for name, attributes in page.elements if name == "circle"]
    shares = {gap.joint: gap.share for gap in result.where.joints}
    assert len({circle["fill"] for circle in circles}) == len(set(shares.values()))
    for joint, share in shares.items():
        assert f"{joint}: {percent(100.0 * share)}".replace(THIN, " ") in text
    assert "robot" in [attributes.get("id") for _, attributes in page.elements]


@pytest.mark.parametrize("missing", ["no key", "no file"])
def test_a_robot_that_cannot_be_drawn_leaves_one_line(missing: str) -> None:
    robot = {key: value for key, value in ARM6["robot"].items() if key != "urdf"}
    if missing == "no file":
        robot["urdf"] = "/nowhere/arm6.urdf"
    page = Page(gap_report_html(replace(_arm6(), configuration={**ARM6, "robot": robot})))
    assert "The robot is not drawn: " in page.text
    assert "robot" not in [attributes.get("id") for _, attributes in page.elements]


def test_a_cause_elsewhere_is_not_blamed_for_the_widest_gap() -> None:
    result = _arm6("structural")
    cause = replace(result.causes[0], joint="joint_1", other_joint=None, joint_gaps=())
    joints = tuple(
        replace(gap, share=0.9 if gap.joint == "joint_5" else 0.02) for gap in result.where.joints
    )
    where = replace(result.where, joints=joints)
    error = ParameterError("joint_5", 1.0, 1.0, 0.1, 0.99, 0.3)
    result = replace(result, where=where, causes=(cause,), parameter_errors=(error,))
    first, second, *_ = diagnosis_headline(result)
    assert "joint_5" in first
    assert second.index("parameter values") < second.index("joint_1")
    assert "--remainder" in diagnosis_steps(Report(result))[0].code
    assert export_options(result) == ("--remainder",), "the terminal says the same"
