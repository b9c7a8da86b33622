"""Recordings of several rates, and channels that stand still now and then."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bags import simulated_arms
from bags.simulated_arms import CONFIG, SimulatedArm, arm2
from idim_iv_ros import IdentificationResult, identify, identify_recordings, load_configuration
from idim_iv_ros.diagnosis.refit.baseline import baseline
from idim_iv_ros.diagnosis.refit.noise_floor import REPEATS, noise_floors, repeats_of
from idim_iv_ros.diagnosis.tracking import simulated_tracking
from idim_iv_ros.errors import DataError, UsageError
from idim_iv_ros.estimation.likelihood import Regression
from idim_iv_ros.identification.prepare import prepare
from idim_iv_ros.recording import read
from idim_iv_ros.recording.recording import Recording, Signal
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from tests.estimation.test_simulated_arms import off_by, recorded, truth_of
from tests.inputs import changed

FAST, SLOW = 1000.0, 250.0


def at_rate(recording: Recording, every: int, name: str, start: float) -> Recording:
    """One in `every` samples of a recording, as a slower driver would have published them."""

    def thinned(signal: Signal | None) -> Signal | None:
        if signal is None:
            return None
        return Signal(signal.values[::every], signal.invented[::every], signal.origin)

    parts = ("position", "effort", "position_reference", "velocity_reference")
    changed = {part: thinned(getattr(recording, part)) for part in parts}
    rate = recording.rate / every
    return replace(recording, path=Path(name), rate=rate, start=start, **changed)


@pytest.fixture(scope="module")
def arm() -> SimulatedArm:
    return arm2(seconds=10.0)


@pytest.fixture(scope="module")
def second(arm: SimulatedArm) -> Recording:
    return recorded(arm2(seconds=10.0, seed=2), 2)


def pair(
    arm: SimulatedArm, second: Recording, every: int, *, slow_first: bool = False
) -> list[Recording]:
    first = replace(recorded(arm, 1), path=Path("fast.mcap"), start=50.0)
    return [first, at_rate(second, every, "slow.mcap", 0.0 if slow_first else 100.0)]


@pytest.mark.parametrize("slow_first", [False, True])
def test_every_recording_is_filtered_at_the_same_frequencies(arm, second, slow_first) -> None:
    prepared = prepare(pair(arm, second, 4, slow_first=slow_first), arm.configuration)
    assert {motion.signals.rate for motion in prepared.motions} == {FAST, SLOW}
    row_rate, edge = prepared.cutoffs.row_rate, arm.configuration.processing.decimation_edge
    for motion in prepared.motions:
        assert motion.cutoff == prepared.cutoffs.position
        assert motion.signals.rate / motion.decimation.factor == pytest.approx(row_rate)
        time = np.arange(motion.decimation.samples) / motion.signals.rate
        for frequency, gain in ((0.5 * prepared.cutoffs.decimation, 1.0), (0.65 * row_rate, 0.0)):
            tone = motion.decimation.whole(np.sin(2.0 * np.pi * frequency * time))
            assert np.sqrt(2.0) * np.std(tone[20:-20]) == pytest.approx(gain, abs=0.03)
        # The position filter is run forward and backward: half the amplitude at its cut-off.
        time = np.arange(len(motion.position)) / motion.signals.rate
        wave = np.sin(2.0 * np.pi * motion.cutoff * time)
        passed = motion.filtered(np.column_stack([wave, wave]))[200:-200]
        assert np.sqrt(2.0) * np.std(passed) == pytest.approx(0.5, abs=0.02)
    assert 0.5 * edge * row_rate >= prepared.cutoffs.decimation
    (reasons,) = [reason for reason in prepared.reasons if "different rates" in reason]
    assert "slow.mcap with 250 Hz" in reasons
    assert "fast.mcap with 1000 Hz" in reasons


def test_a_slower_recording_gives_the_same_parameters_within_their_deviations(arm) -> None:
    """Against both at 1000 Hz, and against the truth: deviations in their own σ have rms 1."""
    truth, deviations = truth_of(arm), []
    other_motion = arm2(seconds=10.0, seed=2)
    for seed in range(30, 32):
        first = replace(recorded(arm, seed), path=Path("fast.mcap"), start=50.0)
        second = recorded(other_motion, seed + 20)
        slow = at_rate(second, 4, "slow.mcap", 0.0 if seed % 2 else 100.0)
        mixed = identify_recordings([first, slow], arm.configuration)
        fast = identify_recordings([first, at_rate(second, 1, "b", 100.0)], arm.configuration)
        for one, other in zip(mixed.parameters, fast.parameters, strict=True):
            # 26 of them: three deviations, not two.
            assert abs(one.value - other.value) < 3.0 * np.hypot(one.std, other.std)
            # Noise of the slow half is twice as large in a row; 2 were all of it slow.
            assert 1.0 < one.white_std / other.white_std < 2.0
        assert mixed.instruments.accepted
        assert {bag.rate for bag in mixed.bags} == {FAST, SLOW}
        slowest = max(mixed.processing.decimation_factors)
        assert mixed.processing.row_rate == pytest.approx(FAST / slowest)
        deviations.append(off_by(mixed, truth))
    assert np.sqrt(np.mean(np.square(deviations))) < 1.5


def test_a_diagnosis_of_both_rates_has_rows_repeats_and_tracking_of_both(arm: SimulatedArm) -> None:
    """The second recording repeats the first, a second later, at a quarter of its rate."""
    first = recorded(arm, 1)
    again = recorded(arm, 2)
    cut = {
        part: Signal(value.values[1000:], value.invented[1000:], value.origin)
        for part in ("position", "effort", "position_reference", "velocity_reference")
        if (value := getattr(again, part)) is not None
    }
    later = at_rate(replace(again, **cut), 4, "slow.mcap", 100.0)
    data = baseline([replace(first, path=Path("fast.mcap")), later], arm.configuration)
    assert data.row_rate == pytest.approx(SLOW / data.prepared.motions[1].decimation.factor)
    assert [len(m.kept) for m in data.motions] == [len(m.kept) for m in data.prepared.motions]
    assert len(data.motions[0].kept) == pytest.approx(
        len(data.motions[1].kept) * 10.0 / 9.0, rel=0.1
    )
    (repeat,) = repeats_of(data)
    assert (repeat.first, repeat.second, repeat.lag) == (0, 1, -1000)
    regression: Regression = data.regression
    fit = regression.fit()
    for floor, rows, noise in zip(
        noise_floors(data, fit, [repeat]), regression.joints, (0.45, 0.175), strict=True
    ):
        assert floor.origin == REPEATS
        # White noise of both, in the band of the rows: mean of its variances.
        band = 0.5 * 0.95 * data.row_rate
        expected = noise * np.sqrt(np.mean([band / (0.5 * FAST), band / (0.5 * SLOW)]))
        assert floor.sigma == pytest.approx(expected, rel=0.25)
        assert len(rows.torque) > 0
    tracked = simulated_tracking(data, data.estimate.linear.values)
    assert [motion.signals.rate for motion in tracked.data.prepared.motions] == [FAST, SLOW]
    energies, seconds = tracked.block_energies[:, 0], tracked.block_energies[:, -1].sum()
    assert seconds == pytest.approx(
        sum((m.span.stop - m.span.start) / m.signals.rate for m in data.prepared.motions)
    )
    assert tracked.rms["joint_1"] == pytest.approx(np.sqrt(energies.sum() / seconds))


def test_rates_that_no_decimation_brings_together_are_refused_with_both(arm, second) -> None:
    odd = replace(at_rate(second, 1, "odd.mcap", 100.0), rate=400.0)
    wide = changed(arm.configuration, "processing", position_cutoff=180.0, decimation_cutoff=150.0)
    first = replace(recorded(arm, 1), path=Path("fast.mcap"))
    with pytest.raises(
        DataError, match=r"fast\.mcap with 1000 Hz, odd\.mcap with 400 Hz"
    ) as refusal:
        identify_recordings([first, odd], wide)
    assert "processing.decimation_cutoff" in str(refusal.value)


def test_a_cutoff_that_the_slowest_recording_does_not_hold_is_refused_with_its_name(arm, second):
    wide = changed(arm.configuration, "processing", position_cutoff=200.0)
    with pytest.raises(UsageError, match=r"250 samples per second of slow\.mcap"):
        identify_recordings(pair(arm, second, 4), wide)


JOINTS = ["joint_1", "joint_2"]
LENGTH = 80  # samples at 1 kHz


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The same ten seconds, whole and with an effort of joint 2 that freezes 20 times."""
    record = simulated_arms.record(simulated_arms.arm2(), 1)
    folder = tmp_path_factory.mktemp("frozen")
    frozen = record.effort.copy()
    for start in np.random.default_rng(2).integers(500, 9000, 20):
        frozen[start : start + LENGTH, 1] = frozen[start - 1, 1]
    paths = folder / "whole.mcap", folder / "frozen.mcap"
    for path, effort in zip(paths, (record.effort, frozen), strict=True):
        states = JointTopic("/joint_states", JOINTS, record.time, record.position, None, effort)
        reference = record.position_reference
        topics = [states, JointTopic("/joint_reference", JOINTS, record.time, reference)]
        write_bag(path, topics)
    return paths


def _identified(bag: Path) -> IdentificationResult:
    return identify([bag], load_configuration(CONFIG / "arm2.yaml"))


def _furthest(first: IdentificationResult, second: IdentificationResult) -> float:
    """Largest difference of two estimates, in standard deviations of the first."""
    pairs = zip(first.parameters, second.parameters, strict=True)
    return max(abs(one.value - two.value) / one.std for one, two in pairs)


def test_estimates_stay_within_the_confidence_of_the_whole_recording(bags, monkeypatch) -> None:
    whole, frozen = (_identified(bag) for bag in bags)
    assert _furthest(whole, frozen) < 1.96
    assert not any("freezes" in reason for reason in whole.processing.reasons)
    (warning,) = [reason for reason in frozen.processing.reasons if "freezes" in reason]
    assert warning.startswith("frozen.mcap: effort of joint_2 on /joint_states")
    monkeypatch.setattr(read, "without_frozen", lambda stamped, *_: (stamped, ()))
    assert _furthest(whole, _identified(bags[1])) > 4.0
