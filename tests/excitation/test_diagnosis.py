"""Motions for diagnosis: every segment does what its label says."""

import numpy as np
import pytest

from idim_iv_ros.effects.registry import EFFECTS as CATALOGUE
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.excitation.diagnosis import EFFECTS, NOT_REVEALED, design_diagnosis, loop_bandwidth
from tests.excitation.independent import assert_limits_hold, assert_signals_agree


def of_kind(diagnosis, kind: str):
    """Segments of a kind with their samples: position, velocity, acceleration."""
    motion = diagnosis.trajectory
    for segment in diagnosis.segments:
        if segment.kind == kind:
            part = slice(round(segment.start * motion.rate), round(segment.end * motion.rate))
            yield (segment, motion.position[part], motion.velocity[part], motion.acceleration[part])


def test_every_limit_holds_at_every_sample(diagnosis) -> None:
    model, limits, made = diagnosis
    assert_limits_hold(model, limits, made.trajectory)
    assert_signals_agree(made.trajectory)


def test_duration_is_a_budget_that_is_used(diagnosis) -> None:
    assert 90.0 < diagnosis[2].trajectory.duration <= 100.0


def test_motion_rests_at_both_ends_and_around_every_segment(diagnosis) -> None:
    motion = diagnosis[2].trajectory
    places = [0, len(motion.position) - 1]
    for segment in diagnosis[2].segments:
        places += [round(segment.start * motion.rate) - 1, round(segment.end * motion.rate)]
    assert np.abs(motion.velocity[places]).max() < 1e-12
    assert np.abs(motion.acceleration[places]).max() < 1e-12
    np.testing.assert_allclose(motion.position[0], motion.position[-1], atol=1e-12)


@pytest.mark.parametrize("kind", ["range_sweep", "creep", "plateau"])
def test_speed_is_constant_in_both_directions(diagnosis, kind: str) -> None:
    count = 0
    for segment, _, velocity, acceleration in of_kind(diagnosis[2], kind):
        speed = segment.speed
        for sign in (1.0, -1.0):
            steady = np.all(np.abs(velocity - sign * speed) < 1e-9 * np.abs(speed), axis=1)
            assert steady.sum() / diagnosis[2].trajectory.rate > 0.2
            assert np.abs(acceleration[steady][:-1]).max() < 1e-9
        count += 1
    assert count == {"range_sweep": 2, "creep": 2, "plateau": 10}[kind]


def test_plateaus_fall_in_speed_at_two_postures(diagnosis) -> None:
    speeds, middles, velocity = [], [], diagnosis[1].velocity
    for segment, position, _, _ in of_kind(diagnosis[2], "plateau"):
        speeds.append(np.abs(segment.speed))
        middles.append(0.5 * (position.min(axis=0) + position.max(axis=0)))
    for half in (slice(0, 5), slice(5, 10)):
        shares = np.array(speeds[half]) / speeds[half][0]
        expected = np.array([1.0, 0.75, 0.5, 0.25, 0.1])[:, None]
        np.testing.assert_allclose(shares, np.broadcast_to(expected, shares.shape))
        assert np.all(speeds[half][0] > 0.2 * velocity)
    assert np.abs(middles[0] - middles[5]).max() > 0.2


def test_reversals_have_the_amplitude_of_their_label(diagnosis) -> None:
    amplitudes = []
    for segment, position, velocity, _ in of_kind(diagnosis[2], "reversals"):
        reach = np.abs(position - position[0]).max(axis=0)
        np.testing.assert_allclose(reach, segment.amplitude, rtol=0.02)
        assert np.sum(np.diff(np.sign(velocity[1:-1, 0])) != 0.0) >= 6
        amplitudes.append(reach[0])
    assert min(amplitudes) == pytest.approx(0.0005, rel=0.02)
    assert max(amplitudes) == pytest.approx(0.01, rel=0.02)


def test_multisine_reaches_two_to_three_bandwidths_at_small_amplitude(diagnosis) -> None:
    made = diagnosis[2]
    ((segment, position, velocity, _),) = of_kind(made, "multisine")
    assert np.abs(position - position[0]).max() <= 0.0051
    lines = np.abs(np.fft.rfft(velocity * np.hanning(len(velocity))[:, None], axis=0))
    frequency = np.fft.rfftfreq(len(velocity), 1.0 / made.trajectory.rate)
    for joint, bandwidth in enumerate(made.bandwidth):
        strong = frequency[lines[:, joint] > 0.2 * lines[:, joint].max()]
        assert 2.0 * bandwidth < strong.max() < 3.0 * bandwidth
        assert strong.min() < bandwidth / 2.0
    assert segment.frequency[1] == pytest.approx(2.5 * made.bandwidth.max())


def test_joints_share_no_line_of_the_multisine(diagnosis) -> None:
    made = diagnosis[2]
    rate = made.trajectory.rate
    ((_, _, velocity, _),) = of_kind(made, "multisine")
    ramp = round(rate)
    lines = np.abs(np.fft.rfft(velocity[ramp:-ramp], axis=0))
    strong = lines > 0.3 * lines.max(axis=0)
    assert np.all(strong.sum(axis=0) >= 5)
    assert strong.sum(axis=1).max() == 1


def test_repeats_are_identical_and_spread_over_the_session(diagnosis) -> None:
    made = diagnosis[2]
    segments, stretches = zip(
        *((segment, position) for segment, position, _, _ in of_kind(made, "repeat")), strict=True
    )
    assert len(segments) == 3
    assert np.ptp(stretches[0], axis=0).min() > 0.3
    for other in stretches[1:]:
        np.testing.assert_allclose(other, stretches[0], atol=1e-12)
    assert segments[0].start < 1.0
    assert 0.3 < segments[1].start / made.trajectory.duration < 0.7
    assert segments[2].end > 0.97 * made.trajectory.duration


def test_effects_are_named_as_the_gap_names_its_causes() -> None:
    revealed = {effect for effects in EFFECTS.values() for effect in effects}
    assert revealed | set(NOT_REVEALED) == set(CATALOGUE)
    assert not revealed & set(NOT_REVEALED)


def test_bandwidth_of_each_law(robots) -> None:
    pd, _ = loop_bandwidth(robots("arm2")[0].controller, np.array([2.0, 0.5]))
    np.testing.assert_allclose(pd, np.sqrt([600.0, 500.0]) / (2.0 * np.pi))
    cascade, configured = loop_bandwidth(robots("emps")[0].controller, np.array([1.0]))
    np.testing.assert_allclose(cascade, 160.18 / (2.0 * np.pi))
    assert configured
    assert not loop_bandwidth(robots("double_pendulum")[0].controller, np.ones(2))[1]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"duration": 30.0}, "duration 30"),
        ({"duration": float("nan")}, "duration nan"),
        ({"rate": 10.0}, "rate 10"),
        ({"start": np.array([0.0, 9.0])}, "start of joint joint_2"),
    ],
)
def test_requests_that_cannot_be_are_one_line(arm2, arguments, complaint: str) -> None:
    configuration, model, limits = arm2
    with pytest.raises((UsageError, DataError), match=complaint):
        design_diagnosis(model, limits, configuration, **arguments)
