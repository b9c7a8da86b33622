"""A law that differentiates and filters its positions is the configured law.

The commands are computed here, sample by sample, as a drive would: nothing of the check is used.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from bags.simulated_arms import SimulatedArm
from idim_iv_ros.diagnosis.controller import check_law
from idim_iv_ros.diagnosis.refit.baseline import Baseline
from idim_iv_ros.diagnosis.refit.law_speed import law_speed
from idim_iv_ros.signals import JointSignals
from tests.diagnosis.simulated_sessions import with_signals


def commanded(data: Baseline, effort: np.ndarray, velocity: np.ndarray | None = None) -> Baseline:
    return with_signals(data, torque=effort, velocity=velocity)


def commands(
    arm: SimulatedArm, signals: JointSignals, factor: float, *, scale: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Commands of a PD law whose speed is a filtered backward difference, and that speed."""
    position, speeds, efforts = signals.position, [], []
    speed = np.zeros(position.shape[1])
    for k in range(len(position)):
        difference = (position[k] - position[max(k - 1, 0)]) * signals.rate
        speed = speed + factor * (difference - speed)
        error = signals.position_reference[k] - position[k]
        slip = signals.velocity_reference[k] - speed
        efforts.append(arm.law.kp * error + scale * arm.law.kd * slip)
        speeds.append(speed)
    return np.array(efforts), np.array(speeds)


@pytest.mark.parametrize("factor", [1.0, 0.45, 0.12])
def test_a_filtered_speed_is_no_mismatch(arm: SimulatedArm, data: Baseline, factor: float) -> None:
    effort, _ = commands(arm, data.prepared.motions[0].signals, factor)
    changed = commanded(data, effort)
    chosen = law_speed(changed.prepared.motions, arm.law)
    assert chosen.kind == "filtered"
    assert chosen.factor == pytest.approx(factor, rel=0.05)
    assert check_law(changed).causes == ()


def test_the_recorded_velocity_is_tried(arm: SimulatedArm, data: Baseline) -> None:
    signals = data.prepared.motions[0].signals
    effort, speed = commands(arm, signals, 0.3)
    # An observer that no first-order filter imitates: the mean of a fast and a slow filter.
    _, slow = commands(arm, signals, 0.05)
    observed = 0.5 * (speed + slow)
    effort = effort + arm.law.kd * (speed - observed)
    changed = commanded(data, effort, observed)
    assert law_speed(changed.prepared.motions, arm.law).kind == "recorded"
    assert check_law(changed).causes == ()


def test_another_gain_beside_a_filtered_speed_is_found(arm: SimulatedArm, data: Baseline) -> None:
    effort, _ = commands(arm, data.prepared.motions[0].signals, 0.3, scale=1.4)
    findings = check_law(commanded(data, effort)).causes
    assert {finding.joint for finding in findings} == set(data.joints)
    for finding in findings:
        joint = data.joints.index(finding.joint)
        assert finding.parameters["kd"].value == pytest.approx(1.4 * arm.law.kd[joint], rel=0.05)


def test_pulses_beside_the_law_are_said_with_their_size_and_times(arm, data) -> None:
    signals = data.prepared.motions[0].signals
    effort, _ = commands(arm, signals, 0.3)
    time = np.arange(len(effort)) / signals.rate
    pulse = (np.abs(time - 4.0) < 0.2) | (np.abs(time - 8.5) < 0.2)
    size = np.sqrt(np.mean(effort[:, 1] ** 2))
    effort[:, 1] += 3.0 * size * pulse
    check = check_law(commanded(data, effort))
    (sentence,) = check.beyond
    assert "joint_2" in sentence
    times = re.findall(r"from (\S+) to (\S+) s of", sentence)
    assert sorted((float(first), float(last)) for first, last in times) == [
        (pytest.approx(3.8, abs=0.05), pytest.approx(4.2, abs=0.05)),
        (pytest.approx(8.3, abs=0.05), pytest.approx(8.7, abs=0.05)),
    ]


def test_a_law_that_explains_its_commands_leaves_nothing_to_say(arm, data) -> None:
    effort, _ = commands(arm, data.prepared.motions[0].signals, 0.3)
    assert check_law(commanded(data, effort)).beyond == ()


def delayed(effort: np.ndarray, periods: list[float]) -> np.ndarray:
    """Each joint's effort recorded as many samples late."""
    time = np.arange(len(effort), dtype=float)
    columns = [
        np.interp(time - late, time, column) for late, column in zip(periods, effort.T, strict=True)
    ]
    return np.column_stack(columns)


def test_a_lag_that_all_joints_share_is_the_recording_s_as_far_as_it_is_measured_late(arm, data):
    signals = data.prepared.motions[0].signals
    effort, _ = commands(arm, signals, 0.3)
    period = 1.0 / signals.rate
    late = commanded(data, delayed(effort, [3.0, 3.0]))
    assert check_law(late, shift=-1.5 * period).causes == ()
    assert check_law(late, shift=-1.5 * period).delay == ()
    # The same lag of commands that are recorded before they act is one of the loop.
    check = check_law(late, shift=0.5 * period)
    assert check.causes == ()
    (cause,) = check.delay
    assert (cause.effect, cause.joint) == ("time_delay", None)
    delay = cause.parameters["delay"]
    assert delay.std is not None
    assert delay.value == pytest.approx(3.0 * period, abs=3.0 * delay.std)
    assert delay.std < 0.3 * period


def test_a_lag_beyond_that_of_the_other_joint_is_the_law_s(arm, data) -> None:
    signals = data.prepared.motions[0].signals
    effort, _ = commands(arm, signals, 0.3)
    late = commanded(data, delayed(effort, [0.5, 3.5]))
    (finding,) = check_law(late, shift=-3.0 / signals.rate).causes
    assert finding.joint == data.joints[1]
    assert finding.parameters["lag"].value == pytest.approx(3.5 / signals.rate, rel=0.1)


def test_efforts_of_one_joint_that_are_much_off_do_not_decide(arm, data) -> None:
    """A joint whose effort is also what another signal makes it, as a later speed would."""
    signals = data.prepared.motions[0].signals
    effort, _ = commands(arm, signals, 0.3)
    _, later = commands(arm, signals, 0.12)
    _, speed = commands(arm, signals, 0.3)
    time = np.arange(len(effort)) / signals.rate
    wrong = 1.0 + np.sin(3.0 * time)
    effort[:, 1] -= 3.0 * arm.law.kd[1] * (later - speed)[:, 1] * wrong
    chosen = law_speed(commanded(data, effort).prepared.motions, arm.law)
    assert chosen.kind == "filtered"
    assert chosen.factor == pytest.approx(0.3, rel=0.1)


def test_commands_far_beyond_the_limit_do_not_reach_the_samples_beside_them(arm, data) -> None:
    """Steps of the reference that ask for several times the limit, as a robot that clips them."""
    signals = data.prepared.motions[0].signals
    time = np.arange(len(signals.position)) / signals.rate
    wanted = signals.position_reference.copy()
    for begin in (2.0, 5.0, 9.0):
        wanted[(time > begin) & (time < begin + 0.03)] += 0.5
    stepped = replace(signals, position_reference=wanted)
    effort, _ = commands(arm, stepped, 0.3)
    limit = arm.law.torque_limit
    assert np.all(np.abs(effort).max(axis=0) > 3.0 * limit)
    changed = with_signals(data, position_reference=wanted, torque=np.clip(effort, -limit, limit))
    assert law_speed(changed.prepared.motions, arm.law).factor == pytest.approx(0.3, rel=0.05)
    check = check_law(changed)
    assert check.causes == ()
    assert check.beyond == ()


def test_a_feedforward_over_the_acceleration_is_no_late_speed(arm, data) -> None:
    """Of 10 ms times kd, it looks like one of a speed that is filtered as much."""
    signals = data.prepared.motions[0].signals
    assert signals.velocity_reference is not None
    forward = 10e-3 * arm.law.kd
    wanted = np.gradient(signals.velocity_reference, 1.0 / signals.rate, axis=0)
    effort, speed = commands(arm, signals, 1.0)
    changed = commanded(data, effort + forward * wanted, speed)
    assert law_speed(changed.prepared.motions, arm.law).kind != "filtered"
    findings = {finding.joint: finding for finding in check_law(changed).causes}
    assert set(findings) == set(data.joints)
    for joint, expected in zip(data.joints, forward, strict=True):
        (name,) = findings[joint].parameters
        assert name == "feedforward_acceleration"
        assert findings[joint].parameters[name].value == pytest.approx(expected, rel=0.03)
