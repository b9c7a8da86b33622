"""Whether another control law than the configured one is seen in the commands, and only then.

The closed-loop simulator records the robot; the check sees positions, references and efforts.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from bags.simulated_arms import SimulatedArm, arm2
from idim_iv_ros.diagnosis.controller import check_law, law_change
from idim_iv_ros.diagnosis.refit.baseline import Baseline, baseline
from idim_iv_ros.diagnosis.refit.command_rows import LawCommands, LawSpeed, law_speed
from idim_iv_ros.diagnosis.result.causes import Cause
from idim_iv_ros.effects.cause import EffectParameter
from idim_iv_ros.signals.joint_side import JointSignals
from idim_iv_ros.simulation import simulate_closed_loop
from tests.diagnosis.motions import with_signals
from tests.diagnosis.test_answer import cause
from tests.estimation.test_simulated_arms import recorded


@pytest.fixture(scope="module")
def signals(data: Baseline) -> JointSignals:
    return data.prepared.motions[0].signals


def diagnosed(arm: SimulatedArm, seed: int, **gains: np.ndarray) -> Baseline:
    """Data of a robot with other gains than those that are configured."""
    robot = replace(arm, law=replace(arm.law, **gains))  # type: ignore[arg-type]
    return baseline([recorded(robot, seed)], arm.configuration)


def causes_of(arm: SimulatedArm, seed: int, **gains: np.ndarray) -> list[Cause]:
    return list(check_law(diagnosed(arm, seed, **gains)).causes)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_configured_law_is_no_mismatch(arm: SimulatedArm, seed: int) -> None:
    assert causes_of(arm, seed) == []


@pytest.mark.parametrize(
    ("name", "joint", "factor"), [("kp", 1, 1.3), ("kp", 0, 0.8), ("kd", 1, 1.4), ("kd", 0, 0.7)]
)
def test_another_gain_is_found_at_its_joint_with_its_size(arm, name, joint, factor) -> None:
    gains = getattr(arm.law, name).copy()
    gains[joint] *= factor
    (finding,) = causes_of(arm, 1, **{name: gains})
    assert finding.joint == arm.configuration.robot.joints[joint]
    assert finding.evidence.statistic > 30.0
    assert finding.torque_gap.after < finding.torque_gap.before
    assert set(finding.parameters) == {name}
    assert finding.parameters[name].value == pytest.approx(gains[joint], rel=0.03)


@pytest.mark.parametrize(("bits", "noisy"), [(12, ("joint_1", "joint_2")), (13, ("joint_1",))])
def test_coarse_encoders_are_no_other_gains(bits: int, noisy: tuple[str, ...]) -> None:
    """A law evaluated on coarser positions than the robot's has smaller gains by least squares."""
    arm = arm2(seconds=20.0, rate=500.0)
    recording = recorded(arm, 1)
    step = 2.0 * np.pi / 2**bits
    coarse = step * np.round(recording.position.values / step)
    positions = replace(recording.position, values=coarse)
    law = check_law(baseline([replace(recording, position=positions)], arm.configuration))
    assert law.causes == ()
    assert law.too_noisy == noisy


def test_an_integral_that_is_not_configured_is_found(arm: SimulatedArm) -> None:
    (finding,) = causes_of(arm, 1, ki=np.array([0.0, 400.0]))
    assert finding.joint == "joint_2"
    assert finding.parameters["ki"].value == pytest.approx(400.0, rel=0.1)


@pytest.mark.parametrize(
    ("joint", "factor", "left"),
    [("joint_2", 1 / 1.15, 0), ("joint_2", 1.15, 1), ("joint_1", 1 / 1.15, 1)],
)
def test_a_gain_of_the_recorded_effort_is_no_other_law(arm, joint, factor, left) -> None:
    """The effort of joint 2 is recorded too large: the law holds with the inverse, only there."""
    recording = recorded(arm, 1)
    larger = replace(recording.effort, values=recording.effort.values * [1.0, 1.15])
    data = baseline([replace(recording, effort=larger)], arm.configuration)
    law = check_law(data)
    assert [cause.joint for cause in law.causes] == ["joint_2"]
    gain = {"factor": EffectParameter(factor, 0.004, "")}
    gained = replace(cause("torque_gain", "parametric"), joint=joint, parameters=gain)
    assert len(law.not_shown_by_torque(data, [gained], ()).causes) == left


@pytest.mark.parametrize(("late", "names"), [(-6e-3, []), (6e-3, ["joint_1"])])
def test_commands_stamped_too_early_are_no_other_law(arm, late, names) -> None:
    """No law acts before it has measured; one that acts too late is another."""
    data = diagnosed(arm, 1)
    signals = data.prepared.motions[0].signals
    torque = signals.torque.copy()
    time = np.arange(len(torque)) / signals.rate
    torque[:, 0] = np.interp(time - late, time, torque[:, 0])
    causes = check_law(with_signals(data, torque=torque)).causes
    assert [finding.joint for finding in causes] == names


@pytest.mark.parametrize("beyond", [2.0, 1e6])
def test_references_of_something_else_are_no_other_law(data, signals, beyond: float) -> None:
    """A step that the robot did not follow; and commands that are always at their limit."""
    reference = signals.position_reference.copy()
    reference[:, 0] += beyond * (np.arange(len(reference)) > 0.4 * len(reference) * (beyond < 1e3))
    law = check_law(with_signals(data, position_reference=reference))
    assert "joint_1" not in {finding.joint for finding in law.causes}


def test_pulses_in_the_command_are_no_other_law(arm: SimulatedArm) -> None:
    """They push the robot, and the errors that the law answers follow each of them."""
    rng = np.random.default_rng(4)
    pulses = np.zeros_like(arm.position_reference)
    for start in rng.choice(np.arange(200, len(pulses) - 200, 400), 10, replace=False):
        pulses[start : start + 20, 0] = rng.choice([-25.0, 25.0])
    result = simulate_closed_loop(
        arm.robot,
        arm.truth,
        arm.law,
        rate=arm.rate,
        position_reference=arm.position_reference,
        velocity_reference=arm.velocity_reference,
        initial_position=arm.position_reference[0],
        initial_velocity=np.zeros(2),
        disturbance=pulses,
    )
    noise = rng.standard_normal(pulses.shape) * [0.2, 0.08]
    plain = recorded(arm, 1)
    moved = replace(
        plain,
        position=replace(plain.position, values=result.position),
        velocity=None,
        effort=replace(plain.effort, values=result.torque + pulses + noise),
    )
    check = check_law(baseline([moved], arm.configuration))
    (sentence,) = check.beyond
    assert check.causes == () and sentence.startswith("the commands of joint_1 hold")
    gains = arm.law.kd * [0.7, 1.0]
    assert [cause.joint for cause in causes_of(arm, 1, kd=gains)] == ["joint_1"]


def commanded(data: Baseline, effort: np.ndarray, velocity: np.ndarray | None = None) -> Baseline:
    return with_signals(data, torque=effort, velocity=velocity)


def commands(
    arm: SimulatedArm, signals: JointSignals, factor: float, *, scale: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Commands of a PD law whose speed is a filtered backward difference, and that speed."""
    difference = np.diff(signals.position, axis=0, prepend=signals.position[:1]) * signals.rate
    speed = lfilter([factor], [1.0, factor - 1.0], difference, axis=0)
    error = signals.position_reference - signals.position
    return arm.law.kp * error + scale * arm.law.kd * (signals.velocity_reference - speed), speed


@pytest.mark.parametrize(
    ("factor", "late"), [(1.0, 0.0), (0.45, 0.0), (0.12, 0.0), (0.6, 8.0), (0.12, 8.0)]
)
def test_a_filtered_speed_is_no_mismatch(arm, data, signals, factor: float, late: float) -> None:
    """Nor is it where efforts are recorded as many samples late."""
    effort, _ = commands(arm, signals, factor)
    changed = commanded(data, delayed(effort, [late, late]))
    chosen = law_speed(changed.commands)
    assert chosen.kind == "filtered"
    assert chosen.factor == pytest.approx(factor, rel=0.05)
    assert check_law(changed).causes == ()


@pytest.mark.parametrize(("factor", "names"), [(0.1, []), (1.0, ["kd"])])
def test_a_speed_late_by_many_periods_is_no_other_gain(arm, data, signals, factor, names) -> None:
    """Where the speed is not chosen well, gains stand for it: errors of time tell."""
    effort, _ = commands(arm, signals, factor, scale=1.0 if factor < 1.0 else 1.4)
    motions = commanded(data, effort).prepared.motions
    rows = LawCommands(motions, arm.law).late(0, LawSpeed())
    assert rows is not None
    assert list(law_change(rows).changes) == names


def test_the_recorded_velocity_is_tried(arm, data: Baseline, signals: JointSignals) -> None:
    effort, speed = commands(arm, signals, 0.3)
    # An observer that no first-order filter imitates: the mean of a fast and a slow filter.
    _, slow = commands(arm, signals, 0.05)
    observed = 0.5 * (speed + slow)
    effort = effort + arm.law.kd * (speed - observed)
    changed = commanded(data, effort, observed)
    assert law_speed(changed.commands).kind == "recorded"
    assert check_law(changed).causes == ()


def test_another_gain_beside_a_filtered_speed_is_found(arm, data: Baseline, signals) -> None:
    effort, _ = commands(arm, signals, 0.3, scale=1.4)
    findings = check_law(commanded(data, effort)).causes
    assert {finding.joint for finding in findings} == set(data.joints)
    for finding in findings:
        joint = data.joints.index(finding.joint)
        assert finding.parameters["kd"].value == pytest.approx(1.4 * arm.law.kd[joint], rel=0.05)


def delayed(effort: np.ndarray, periods: list[float]) -> np.ndarray:
    """Each joint's effort recorded as many samples late."""
    time = np.arange(len(effort), dtype=float)
    columns = [
        np.interp(time - late, time, column) for late, column in zip(periods, effort.T, strict=True)
    ]
    return np.column_stack(columns)


def test_a_lag_of_all_joints_is_the_recording_s_as_far_as_it_is_measured_late(arm, data, signals):
    effort, _ = commands(arm, signals, 0.3)
    period = 1.0 / signals.rate
    late = commanded(data, delayed(effort, [3.0, 3.0]))
    check = check_law(late, shift=EffectParameter(-1.5 * period, 0.0, "s"))
    assert check.causes == check.delay == ()
    # Half a period more until they act makes it longer than the loop of the configuration.
    check = check_law(late, shift=EffectParameter(0.5 * period, 0.0, "s"))
    assert check.causes == ()
    (cause,) = check.delay
    assert (cause.effect, cause.joint) == ("time_delay", None)
    delay = cause.parameters["delay"]
    assert delay.std is not None
    assert delay.value == pytest.approx((3.0 + 0.5) * period, abs=3.0 * delay.std)
    assert delay.std < 0.3 * period


def test_a_lag_beyond_that_of_the_other_joint_is_the_law_s(arm, data, signals) -> None:
    effort, _ = commands(arm, signals, 0.3)
    late = commanded(data, delayed(effort, [0.5, 3.5]))
    (finding,) = check_law(late, shift=EffectParameter(-3.0 / signals.rate, 0.0, "s")).causes
    assert finding.joint == data.joints[1]
    assert finding.parameters["lag"].value == pytest.approx(3.5 / signals.rate, rel=0.1)
    # Unless its effort is that much later than what acts: then it is recorded late.
    common, recorded_late = (EffectParameter(-k / signals.rate, 1e-5, "s") for k in (0.5, 3.5))
    joint = data.joints[1]
    assert check_law(late, shift=common, of_joints={joint: recorded_late}).causes == ()


def test_commands_far_beyond_the_limit_do_not_reach_the_samples_near_them(arm, data, signals):
    """Steps of the reference that ask for several times the limit, as a robot that clips them."""
    time = np.arange(len(signals.position)) / signals.rate
    wanted = signals.position_reference.copy()
    for begin in (2.0, 5.0, 9.0):
        wanted[(time > begin) & (time < begin + 0.03)] += 0.5
    stepped = replace(signals, position_reference=wanted)
    effort, _ = commands(arm, stepped, 0.3)
    limit = arm.law.torque_limit
    assert np.all(np.abs(effort).max(axis=0) > 3.0 * limit)
    changed = with_signals(data, position_reference=wanted, torque=np.clip(effort, -limit, limit))
    assert law_speed(changed.commands).factor == pytest.approx(0.3, rel=0.05)
    check = check_law(changed)
    assert check.causes == check.beyond == ()


def test_a_feedforward_over_the_acceleration_is_no_late_speed(arm, data, signals) -> None:
    """Of 10 ms times kd, it looks like one of a speed that is filtered as much."""
    assert signals.velocity_reference is not None
    forward = 10e-3 * arm.law.kd
    wanted = np.gradient(signals.velocity_reference, 1.0 / signals.rate, axis=0)
    effort, speed = commands(arm, signals, 1.0)
    changed = commanded(data, effort + forward * wanted, speed)
    assert law_speed(changed.commands).kind != "filtered"
    findings = {finding.joint: finding for finding in check_law(changed).causes}
    assert set(findings) == set(data.joints)
    for joint, expected in zip(data.joints, forward, strict=True):
        (name,) = findings[joint].parameters
        assert name == "feedforward_acceleration"
        assert findings[joint].parameters[name].value == pytest.approx(expected, rel=0.03)
