from dataclasses import replace

import pytest

from idim_iv_ros.diagnosis.result import Cause, GapResult, Stage
from idim_iv_ros.report import gap_report_html
from idim_iv_ros.report.sections.causes import tracking_change
from tests.report.sample_gap import sample_gap

_ERRORS = ({"joint_1": 3e-4, "joint_2": 4e-4}, {"joint_1": 6e-5, "joint_2": 8e-5})


def _parametric(joint: str | None, *tracking: dict[str, float] | None, note: str = "") -> GapResult:
    """A diagnosis as `diagnose` makes it: a parametric cause has no simulation gap of its own."""
    result = sample_gap(2, "parametric")
    cause = replace(result.causes[0], joint=joint, simulation_gap=None)
    given, refit = (
        replace(stage, tracking_rms=errors, note=note)
        for stage, errors in zip((result.stages[0], result.stages[-1]), tracking, strict=True)
    )
    return replace(result, causes=(cause,), stages=(given, refit))


def test_parameter_errors_have_the_tracking_error_of_given_model_and_refit() -> None:
    result = _parametric("joint_2", *_ERRORS)
    change = tracking_change(result, result.causes[0])
    assert change.gap is not None
    assert (change.gap.before, change.gap.after) == (4e-4, 8e-5)
    assert change.gap.shrinkage == pytest.approx(0.8)
    assert change.words.startswith("nominal model → refit")
    assert "0.0800" in gap_report_html(result)


def test_parameter_errors_of_no_single_joint_have_that_of_all_joints() -> None:
    result = _parametric(None, *_ERRORS)
    gap = tracking_change(result, result.causes[0]).gap
    assert gap is not None
    assert (gap.before, gap.after) == pytest.approx((5e-4, 1e-4))
    mixed = replace(result, joint_types=("prismatic", "revolute"))
    assert tracking_change(mixed, mixed.causes[0]).gap is None


def test_a_stage_that_was_not_simulated_is_named_with_the_reason() -> None:
    result = _parametric("joint_1", None, _ERRORS[1], note="the simulation diverges")
    change = tracking_change(result, result.causes[0])
    assert change.gap is None and "the simulation diverges" in change.words
    nothing = _parametric("joint_1", None, None, note="not simulated: no reference")
    assert "mrad →" not in gap_report_html(nothing)


def test_gravity_that_the_given_model_lacks_has_its_own_stage() -> None:
    result = _parametric(None, *_ERRORS)
    weightless = replace(result.stages[0], tracking_rms=None)
    heavy = replace(result.stages[0], name="+gravity_direction")
    stages = (weightless, heavy, result.stages[1])
    gravity = replace(result.causes[0], effect="gravity_direction")
    payload = replace(result.causes[0], joint="joint_1")
    result = replace(result, stages=stages, causes=(gravity, payload))
    assert tracking_change(result, gravity).gap is None
    change = tracking_change(result, payload)
    assert change.gap is not None
    assert change.words.startswith("+ gravity direction → refit")


def test_another_control_law_says_why_it_has_no_tracking_error() -> None:
    result = sample_gap(2, "structural")
    cause: Cause = replace(result.causes[0], effect="controller_mismatch", simulation_gap=None)
    change = tracking_change(result, cause)
    assert change.gap is None
    assert "configured control law" in change.words


def test_a_cause_of_its_own_stage_says_why_that_was_not_simulated() -> None:
    result = sample_gap(2, "structural")
    cause = replace(result.causes[0], simulation_gap=None)
    stages: tuple[Stage, ...] = tuple(
        replace(stage, tracking_rms=None, note="it diverges")
        if stage.name == "+stribeck[joint_2]"
        else stage
        for stage in result.stages
    )
    change = tracking_change(replace(result, stages=stages), cause)
    assert change.gap is None
    assert change.words == "+ stribeck at joint_2 not simulated: it diverges"
