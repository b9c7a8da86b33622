"""The ripple of a current's gain: found, taken out, and not mistaken for one of the torque."""

from dataclasses import replace

import numpy as np
import pytest

from bags.simulated_arms import arm2
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline, smooth_regression
from idim_iv_ros.diagnosis.refit.gain_ripple import (
    GainRipple,
    without_gain_ripples,
)
from tests.diagnosis.test_signal_chain import with_effort
from tests.estimation.test_simulated_arms import recorded

WAVES, SIZE = 120.0, 0.03


@pytest.fixture(scope="module")
def data() -> Baseline:
    """An arm whose efforts are currents with a gain of one."""
    arm = arm2(seconds=20.0)
    signals = arm.configuration.signals.model_copy(update={"effort_scale": [1.0, 1.0]})
    return baseline([recorded(arm, 1)], arm.configuration.model_copy(update={"signals": signals}))


def taken_out(data: Baseline, effort: np.ndarray) -> tuple[Baseline, tuple[GainRipple, ...]]:
    changed = with_effort(data, effort)
    changed, _, ripples = without_gain_ripples(changed, smooth_regression(changed))
    return changed, ripples


def waves(data: Baseline) -> np.ndarray:
    """Over the position of the first joint, beside zeros for the second."""
    (motion,) = data.prepared.motions
    position = motion.signals.position[:, 0]
    return np.column_stack([np.sin(WAVES * position + 0.4), np.zeros(len(position))])


def test_a_ripple_of_the_gain_is_found_and_taken_out(data: Baseline) -> None:
    effort = data.prepared.motions[0].signals.torque
    restored, (ripple,) = taken_out(data, effort / (1.0 + SIZE * waves(data)))
    assert ripple.joint == 0
    assert ripple.wave_number == pytest.approx(WAVES, rel=0.01)
    assert abs(ripple.size - SIZE) < 3.0 * ripple.std
    rippled = with_effort(data, effort / (1.0 + SIZE * waves(data)))
    left, there = (
        np.std(each.rows[0].torque - data.rows[0].torque) for each in (restored, rippled)
    )
    assert left < 0.5 * there
    assert "joint_1" in ripple.sentence(data.joints)


def test_a_ripple_of_the_torque_stays(data: Baseline) -> None:
    effort = data.prepared.motions[0].signals.torque
    _, ripples = taken_out(data, effort + 0.6 * waves(data))
    assert ripples == ()


def test_nothing_is_found_where_nothing_is(data: Baseline) -> None:
    _, ripples = taken_out(data, data.prepared.motions[0].signals.torque)
    assert ripples == ()


def test_torques_that_are_no_currents_are_left_alone(data: Baseline) -> None:
    configuration = data.prepared.configuration
    signals = configuration.signals.model_copy(update={"effort_scale": None})
    configuration = configuration.model_copy(update={"signals": signals})
    plain = replace(data, prepared=replace(data.prepared, configuration=configuration))
    effort = data.prepared.motions[0].signals.torque / (1.0 + SIZE * waves(data))
    assert taken_out(plain, effort)[1] == ()
