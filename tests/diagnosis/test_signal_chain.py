"""The common shift of the effort: half a period for a held command, none for a measured torque.

The truth is that of a zero-order hold: the torque of sample k acts from k to k + 1, so that it is
late by half a period. Nothing of the estimate is used to make the recordings.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from bags import simulated_arms
from bags.simulated_arms import arm2, arm6
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.refit import EffortShift, Refit, _chain, aligned, refitted
from idim_iv_ros.diagnosis.refit.turning_friction import TurningFriction
from idim_iv_ros.recording.recording import Recording
from tests.diagnosis.motions import with_signals
from tests.estimation.test_simulated_arms import recorded
from tests.inputs import changed

PERIOD = 1e-3


def with_effort(data: Baseline, effort: np.ndarray) -> Baseline:
    """Return the same recording with other efforts (n_samples, n_joints)."""
    changed = with_signals(data, torque=effort)
    (motion,) = changed.prepared.motions
    rows = tuple(
        replace(row, torque=motion.decimation.whole(motion.torque[:, j])[motion.kept[:, j]])
        for j, row in enumerate(data.rows)
    )
    return replace(changed, regression=replace(data.regression, joints=rows))


def later(effort: np.ndarray, delays: list[float], rate: float) -> np.ndarray:
    """Efforts that are recorded `delays` (s, by joint) before they act."""
    time = np.arange(len(effort)) / rate
    pairs = zip(effort.T, delays, strict=True)
    return np.column_stack([CubicSpline(time, values)(time + delay) for values, delay in pairs])


def effort_of(recording: Recording) -> np.ndarray:
    return np.asarray(recording.effort.values)


def test_a_measured_torque_is_not_shifted(data: Baseline) -> None:
    _, chain = aligned(data)
    assert abs(chain.common.value) < 3.0 * chain.common.std
    assert not chain.chain.differing


def test_a_held_command_is_half_a_period_later_than_its_mean(arm, data) -> None:
    command = simulated_arms.record(arm, 1).truth.torque
    mean = 0.5 * (command + np.vstack([command[:1], command[:-1]]))  # what acts around each sample
    chains = [aligned(with_effort(data, effort))[1] for effort in (command, mean)]
    assert all(not chain.chain.differing for chain in chains)
    assert chains[0].common.value - chains[1].common.value == pytest.approx(0.5 * PERIOD, rel=0.02)
    assert abs(chains[1].common.value) < 3.0 * chains[1].common.std


@pytest.mark.parametrize("delay", [-0.8e-3, 1.3e-3, 6e-3])
def test_a_shift_of_all_joints_is_estimated_and_taken_out(arm, data, delay) -> None:
    effort = effort_of(recorded(arm, 1))
    unshifted, plain = aligned(data)
    shifted, chain = aligned(with_effort(data, later(effort, [delay, delay], arm.rate)))
    assert chain.common.value - plain.common.value == pytest.approx(delay, abs=0.03 * PERIOD)
    for restored, original in zip(shifted.rows, unshifted.rows, strict=True):
        error = np.std((restored.torque - original.torque)[20:-20])
        assert error < 0.01 * np.std(original.torque)


def test_friction_that_falls_with_the_speed_is_no_delay_of_all_joints(arm, data) -> None:
    """Its torque is higher after a reversal than before, as if it came late."""
    speed = simulated_arms.record(arm, 1).truth.velocity
    falling = np.array([1.5, 0.5]) * np.sign(speed) * np.exp(-((speed / 0.15) ** 2))
    _, shift = aligned(with_effort(data, effort_of(recorded(arm, 1)) + falling))
    assert shift.common.std is not None and not shift.beyond_control
    assert all(abs(one.value) < 2e-3 for one in shift.chain.joint_shifts.values())


def test_a_joint_that_is_later_than_the_other_keeps_its_delay(arm, data) -> None:
    effort = effort_of(recorded(arm, 1))
    _, chain = aligned(with_effort(data, later(effort, [0.0, 4e-3], arm.rate)))
    assert abs(chain.common.value) < 3.0 * chain.common.std
    assert chain.chain.differing == ("joint_2",)
    assert "that of joint_2" in chain.sentence


def early(recording: Recording, delay: float) -> Recording:
    effort = later(effort_of(recording), [delay, delay], recording.rate)
    return replace(recording, effort=replace(recording.effort, values=effort))


@pytest.mark.parametrize("place", ["stamps", "loop"])
def test_a_delay_of_all_joints_is_a_cause_and_the_loop_tells_where_it_is(place: str) -> None:
    arm, delay = arm2(seconds=8.0), 4e-3
    if place == "loop":
        arm = replace(arm, law=replace(arm.law, delay=delay))
    recording = recorded(arm, 1)
    if place == "stamps":
        recording = early(recording, delay)
    refit = refitted([recording], arm.configuration, ())
    (cause,) = refit.delays
    assert (cause.effect, cause.joint) == ("time_delay", None)
    estimate = cause.parameters["delay"]
    assert estimate.std is not None and estimate.std < 0.5e-3
    assert estimate.value == pytest.approx(delay, abs=4.0 * estimate.std)
    assert cause.torque_gap.after < 0.9 * cause.torque_gap.before
    in_loop = refit.data.prepared.configuration.controller.delay
    assert in_loop == pytest.approx(delay if place == "loop" else 0.0, abs=1e-3)
    if place == "stamps":
        assert refitted([recording], arm.configuration, ("time_delay",)).delays == ()


def test_a_loop_that_answers_to_the_steps_of_its_encoders_is_not_late() -> None:
    """Steps of 3 mrad are in the measured positions and, by the law, in the commands."""
    arm = arm6(seconds=10.0)
    recording = recorded(arm, 1)
    position, period = recording.position.values, 1.0 / arm.rate
    steps = np.round(position / 3e-3) * 3e-3 - position
    speeds = np.diff(steps, axis=0, prepend=steps[:1]) / period
    kept = np.exp(-2.0 * np.pi * 100.0 * period)  # of a speed that is filtered at 100 Hz
    speeds = lfilter([1.0 - kept], [1.0, -kept], speeds, axis=0)
    effort = effort_of(recording) - arm.law.kp * steps - arm.law.kd * speeds
    recording = replace(
        recording,
        position=replace(recording.position, values=position + steps),
        effort=replace(recording.effort, values=effort),
    )
    refit = refitted([recording], arm.configuration, ())
    assert refit.delays == () and refit.answers_noise
    assert {one.effect for one in refit.not_testable} == {"time_delay"}


@pytest.mark.parametrize(("delay", "configured"), [(0.0, 0.0), (1.5e-3, 0.0), (0.0, 4e-3)])
def test_a_command_that_is_held_and_computed_for_a_period_is_no_cause(delay, configured) -> None:
    """Nor is a delay of the loop that the configuration has."""
    arm = arm2(seconds=8.0)
    configuration = changed(arm.configuration, "controller", delay=configured)
    arm = replace(arm, law=replace(arm.law, delay=configured))
    assert refitted([early(recorded(arm, 1), delay)], configuration, ()).delays == ()


def test_of_two_joints_that_differ_the_earlier_has_the_common_shift() -> None:
    """A measured effort is a mean over the period before; one drive is late by 0.9 ms beyond it."""
    shifts, deviations = np.array([-0.15e-3, -1.03e-3]), np.array([2e-5, 2e-5])
    chain = _chain(["joint_1", "joint_2"], shifts, deviations, 2e-3)
    assert chain.differing == ("joint_1",)
    assert chain.effort_shift.value == pytest.approx(-1.03e-3)


@pytest.mark.parametrize(("late", "on_time"), [(0.3, range(6)), (1.48, [0, 2, 3, 4, 5])])
def test_a_joint_is_on_time_by_its_own_shift_not_by_a_third_one(late, on_time) -> None:
    """ms; the last joint is unsure enough to share its shift with all others."""
    joints = tuple("abcdef")
    shifts = 1e-3 * np.array([0.31, late, 0.32, 0.46, 0.30, 1.0])
    deviations = 1e-3 * np.array([0.07, 0.08, 0.11, 0.11, 0.09, 0.21])
    shift = EffortShift(_chain(joints, shifts, deviations, 5e-3), 5e-3, 0.0)
    assert shift.chain.differing == ()
    refit = Refit(SimpleNamespace(joints=joints), shift, TurningFriction({}, {}))  # type: ignore
    assert refit.on_time == tuple(("time_delay", joint) for joint in on_time)
