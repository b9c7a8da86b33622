from dataclasses import replace

import numpy as np
import pytest

from idim_iv_ros.statistics.hypothesis import HypothesisTest
from idim_iv_ros.statistics.residuals import diagnose_residual
from idim_iv_ros.statistics.verdict import judge_all, judge_joint
from tests.statistics.test_residuals import joint_with
from tests.statistics.worlds import autoregressive

NULL = "instruments"
VALID = HypothesisTest(NULL, "joint", 1.0, 4, 100, 0.5)
UNTESTED = HypothesisTest.not_run(NULL, "joint", "instruments are smoothed measurements")


def rejected(percent):
    return HypothesisTest(NULL, "joint", 9.0, 4, 100, 1e-6, torque_deviation_percent=percent)


@pytest.fixture(scope="module")
def white():
    return diagnose_residual(joint_with(np.random.default_rng(0).standard_normal(800)), np.ones(3))


@pytest.fixture(scope="module")
def autocorrelated():
    residual = autoregressive(np.random.default_rng(1), [-0.9], (800,))
    return diagnose_residual(joint_with(residual), np.ones(3))


def test_a_valid_joint_is_told_by_its_residual(white, autocorrelated):
    """Autocorrelated: oversampled, with the order of the noise."""
    assert judge_joint(VALID, white).verdict == "valid"
    joint = judge_joint(VALID, autocorrelated)
    assert joint.verdict == "autocorrelated"
    assert f"AR({autocorrelated.ar_order})" in joint.sentence


@pytest.mark.parametrize("percent", [12.0, 0.25])
def test_rejected_is_a_model_error_whatever_the_residual(white, autocorrelated, percent):
    """The paper's point: an autocorrelated residual means oversampling only if Z is valid."""
    for residual in (white, autocorrelated):
        joint = judge_joint(rejected(percent), residual)
        assert joint.verdict == "misspecified"
        assert f"{percent:g} %" in joint.sentence


def noise_below(residual, percent):
    """Noise that leaves so much of the torque to the model's misfit."""
    return residual.rms * np.sqrt(1.0 - (percent / residual.relative_percent) ** 2)


def test_a_rejection_for_next_to_nothing_is_a_note(white, autocorrelated):
    for residual, verdict in ((white, "valid"), (autocorrelated, "autocorrelated")):
        joint = judge_joint(rejected(0.008), residual, [], noise_below(residual, 0.05))
        assert joint.verdict == verdict
        assert "0.008 %" in joint.note
        assert joint.torque_percent == pytest.approx(0.05)
        assert judge_all([joint], rejected(0.008)).verdict == verdict


def test_a_stiff_loop_does_not_make_a_large_residual_small(white):
    """A pendulum without gravity moves the predicted motion by 0.4 % of the torque only."""
    assert judge_joint(rejected(0.4), white, [], noise_below(white, 30.0)).verdict == "misspecified"
    assert judge_joint(rejected(0.4), white, [], None).verdict == "misspecified"


def test_a_note_at_one_joint_does_not_hide_what_all_rows_reject(white):
    """The residual of a joint follows the speed a little; all rows together differ by far more."""
    noted = judge_joint(VALID, white, [left(0.4)], noise_below(white, 5.0))
    assert noted.verdict == "valid" and noted.note and not noted.rejected
    assert judge_all([noted], rejected(3.0)).verdict == "misspecified"
    little = judge_joint(VALID, white, [], noise_below(white, 0.5))
    assert judge_all([little], rejected(0.3)).verdict == "valid"
    assert judge_all([little], rejected(3.0)).verdict == "misspecified"


def test_untested_instruments_tell_nothing_and_say_why(white):
    joint = judge_joint(UNTESTED, white)
    assert joint.verdict == "inconclusive"
    assert "smoothed measurements" in joint.sentence


def left(percent, p_value=1e-9):
    return HypothesisTest(
        "H0", "joint: position", 9.0, 10, 300, p_value, None, 0.001, None, percent
    )


def test_a_residual_that_follows_the_motion_is_a_model_error_though_the_instruments_are_valid(
    white,
):
    verdict = judge_joint(VALID, white, [left(12.3), left(0.2, 0.4)])
    assert verdict.verdict == "misspecified"
    assert "position (12 % of the torque, p = 1e-09)" in verdict.sentence
    both = judge_joint(rejected(5.0), white, [left(12.3)])
    assert both.verdict == "misspecified"
    assert "position (12 %" in both.sentence and "5 %" in both.sentence
    assert judge_joint(VALID, white, [left(1.4)]).verdict == "valid"
    assert judge_joint(VALID, white, [left(12.3, 0.4)]).verdict == "valid"


def test_overall_is_the_least_favourable_joint(white, autocorrelated):
    good, slow = judge_joint(VALID, white), judge_joint(VALID, autocorrelated)
    bad, unknown = judge_joint(rejected(5.0), white), judge_joint(UNTESTED, white)
    assert judge_all([good, good], VALID).verdict == "valid"
    assert judge_all([good, slow], VALID).verdict == "autocorrelated"
    assert judge_all([slow, unknown], VALID).verdict == "inconclusive"
    overall = judge_all([good, bad, unknown], rejected(5.0))
    assert overall.verdict == "misspecified"


def test_the_joint_with_the_largest_residual_beyond_the_noise_is_named_first(white):
    """An effect at joint 2 may reject the instruments of others, and not its own."""
    accused = replace(judge_joint(rejected(3.0), white), joint="joint_3", torque_percent=1.2)
    quiet = replace(judge_joint(VALID, white), joint="joint_2", torque_percent=8.0)
    sentence = judge_all([accused, quiet]).sentence
    assert "joint_2 (8 %" in sentence
    worse = replace(judge_joint(rejected(2.0), white), joint="joint_5", torque_percent=9.0)
    sentence = judge_all([accused, quiet, worse]).sentence
    assert sentence.index("joint_5") < sentence.index("joint_3")
    assert "largest at" not in sentence
