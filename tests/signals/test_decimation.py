"""Parallel decimation against SciPy's own, and chunk by chunk against the whole."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cheby1, decimate, sosfiltfilt

from idim_iv_ros.configuration import Configuration, ProcessingSection
from idim_iv_ros.errors import DataError
from idim_iv_ros.recording.read import read_recordings
from idim_iv_ros.recording.writing.write import JointTopic, write_bag
from idim_iv_ros.signals.cutoffs import Cutoffs
from idim_iv_ros.signals.decimation import ParallelDecimation, common_factors, decimation_factor
from idim_iv_ros.signals.filters import central_differences, zero_phase_butterworth
from idim_iv_ros.signals.joint_side import JointSignals, joint_side
from idim_iv_ros.signals.motion import filter_motion


def noise(samples: int) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(samples, 3)).cumsum(axis=0)


@pytest.mark.parametrize("factor", [2, 10, 13])
def test_whole_record_agrees_with_scipy_away_from_the_edges(factor: int) -> None:
    signal = noise(5000)
    ours = ParallelDecimation(factor, 5000, 0.8).whole(signal)
    scipys = decimate(signal, factor, axis=0, zero_phase=True)
    np.testing.assert_allclose(ours[100:-100], scipys[100:-100], atol=1e-6)


@pytest.mark.parametrize(("samples", "phase", "first"), [(100, "last", 9), (104, "last", 3)])
def test_last_phase_keeps_the_last_sample_of_the_record(samples, phase, first) -> None:
    kept = ParallelDecimation(10, samples, 0.8, phase).kept
    assert kept[0] == first
    assert kept[-1] == samples - 1


@pytest.mark.parametrize("phase", ["first", "last"])
@pytest.mark.parametrize("factor", [1, 7, 100])
def test_chunks_give_what_the_whole_gives(factor: int, phase) -> None:
    signal = noise(60_000)
    decimation = ParallelDecimation(factor, len(signal), 0.95, phase)
    pieces = [decimation.apply(signal[c.first : c.last], c) for c in decimation.chunks(9000)]
    assert len(pieces) > 1
    whole = decimation.whole(signal)
    np.testing.assert_allclose(np.concatenate(pieces), whole, atol=1e-7 * np.abs(whole).max())


def test_cutoff_lies_below_the_edge_of_the_filter() -> None:
    assert decimation_factor(5000.0, 20.0, 0.8) == 100
    assert decimation_factor(1000.0, 40.0, 0.8) == 10
    assert decimation_factor(125.0, 60.0, 0.8) == 1


@pytest.mark.parametrize(
    ("rates", "factors", "row_rate"),
    [
        ((1000.0, 250.0), (44, 11), 250.0 / 11),
        ((250.0, 1000.0), (11, 44), 250.0 / 11),
        ((500.0, 200.0), (20, 8), 25.0),  # 9 would leave 22.2, of which 500 is no multiple
        ((1000.0, 333.0), (45, 15), 333.0 / 15),
        ((499.9, 500.0), (23, 23), 499.9 / 23),
        ((1000.0,), (47,), 1000.0 / 47),
    ],
)
def test_every_rate_has_its_own_factor_to_one_rate_of_rows(rates, factors, row_rate) -> None:
    factors_and_rate = common_factors(rates, 10.0, 0.95)
    assert factors_and_rate == (factors, pytest.approx(row_rate))
    for rate, factor in zip(rates, factors, strict=True):
        assert rate / factor == pytest.approx(row_rate, rel=0.01)
        assert 0.5 * 0.95 * row_rate >= 10.0


@pytest.mark.parametrize(("slow", "together"), [(997.0, True), (980.0, True), (970.0, False)])
def test_rates_of_one_rig_count_as_one_up_to_two_percent(slow: float, together: bool) -> None:
    factors_and_rate = common_factors([1000.0, slow, 1000.0], 40.0, 0.95)
    assert factors_and_rate == (((11, 11, 11), slow / 11) if together else None)


def test_rates_without_a_common_one_have_no_factors() -> None:
    assert common_factors([1000.0, 400.0], 150.0, 0.95) is None
    assert common_factors([1000.0, 400.0], 80.0, 0.95) == ((5, 2), 200.0)


@pytest.mark.parametrize(("columns", "samples"), [(5, 2000), (32, 777), (45, 130), (70, 11)])
def test_many_columns_side_by_side_are_filtered_as_scipy_filters_each(columns, samples) -> None:
    signal = np.random.default_rng(2).normal(size=(samples, columns)).cumsum(axis=0)
    sections = cheby1(8, 0.05, 0.9 / 4, output="sos")
    padding = min(24, samples - 1)
    expected = sosfiltfilt(sections, signal, axis=0, padlen=padding)[::4]
    decimation = ParallelDecimation(4, samples, 0.9)
    np.testing.assert_array_equal(decimation.whole(signal), expected)
    single = decimation.whole(signal.astype(np.float32))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, atol=1e-5 * np.abs(expected).max())


RATE = 1000.0
TIME = np.arange(4000) / RATE


def test_gain_at_the_cutoff_is_one_half_after_two_passes() -> None:
    sine = np.sin(2 * np.pi * 50.0 * TIME)[:, None]
    filtered = zero_phase_butterworth(sine, rate=RATE, cutoff=50.0, order=4)
    assert np.abs(filtered[1000:3000]).max() == pytest.approx(0.5, rel=1e-3)


def test_a_piece_has_the_derivatives_of_the_whole() -> None:
    signal = np.random.default_rng(0).normal(size=(500, 2))
    velocity, acceleration = central_differences(signal, rate=RATE)
    piece = central_differences(signal, rate=RATE, start=100, stop=200)
    np.testing.assert_array_equal(piece[0], velocity[100:200])
    np.testing.assert_array_equal(piece[1], acceleration[100:200])


def test_derivatives_of_a_fast_sine_at_a_low_rate_keep_their_size() -> None:
    """25 Hz at 250 Hz, over five samples; over three it is 12 % too small."""
    rate, pulsation = 250.0, 2 * np.pi * 25.0
    time = np.arange(1000) / rate
    sine = np.sin(pulsation * time)[:, None]
    velocity, acceleration = central_differences(sine, rate=rate, order=4)
    inside = slice(10, -10)
    np.testing.assert_allclose(
        velocity[inside, 0] / pulsation, np.cos(pulsation * time)[inside], atol=6e-3
    )
    np.testing.assert_allclose(acceleration[inside] / pulsation**2, -sine[inside], atol=1.2e-2)


JOINTS = ["a", "b"]


def side(folder: Path, position: float = 1.0, effort: float = 1.0, **sections):
    time = np.arange(500) / 100.0
    wave = np.sin(np.outer(time, [1.0, 2.0]))
    values = (position * wave, None, wave * [1.0, effort])
    write_bag(folder / "r.mcap", [JointTopic("/joint_states", JOINTS, time, *values)])
    configuration = Configuration.model_validate({"robot": {"joints": JOINTS}, **sections})
    (recording,) = read_recordings([folder / "r.mcap"], joints=JOINTS)
    return joint_side(recording, configuration)


@pytest.mark.parametrize("effort", [1e300, 1e-300, 1e-320])
def test_torque_that_no_robot_has_is_refused_by_joint(tmp_path: Path, effort: float) -> None:
    with pytest.raises(DataError, match=r"r\.mcap: .*(torque of b|holds .* for b)"):
        side(tmp_path, effort=effort)


def test_scale_that_makes_an_impossible_torque_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"torque of b .*effort_scale"):
        side(tmp_path, effort=10.0, signals={"effort_scale": [1.0, 1e9]})


def test_position_that_no_robot_has_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"r\.mcap: .*position"):
        side(tmp_path, position=1e8)


def test_torques_of_small_and_large_robots_are_taken(tmp_path: Path) -> None:
    assert np.abs(side(tmp_path, effort=1e-6).torque[:, 1]).max() == pytest.approx(1e-6, rel=0.01)
    assert np.abs(side(tmp_path, effort=1e6).torque[:, 1]).max() == pytest.approx(1e6, rel=0.01)


HERTZ, SAMPLES = 500.0, 2000
NOISE = np.random.default_rng(5).standard_normal(SAMPLES)
ONCE = np.arange(SAMPLES) > 1200  # from one encoder step to the next, and no other
CUTOFFS = Cutoffs(40.0, 16.0, (10,), 50.0, ())


def refusal(*positions: np.ndarray) -> str:
    """What is said of joints that all stand still."""
    position = 0.0145 + np.column_stack(positions)
    valid = np.ones(position.shape, dtype=bool)
    signals = JointSignals("bag", HERTZ, position, NOISE[:, None] + position, valid, *[None] * 3)
    joints = [f"joint_{number + 1}" for number in range(len(positions))]
    with pytest.raises(DataError, match="no joint moves") as refused:
        filter_motion([signals], ProcessingSection(), CUTOFFS, joints)
    return str(refused.value)


@pytest.mark.parametrize(
    "position",
    [
        7e-5 * np.round(0.35 * NOISE),  # the encoder of the report: to and fro over a step
        1.5e-3 * np.round(0.3 * NOISE),  # 12 bits
        1.5e-3 * ONCE,
        5e-3 * NOISE,  # a potentiometer
        0.7 * (np.arange(SAMPLES) == 1000) + 2e-4 * NOISE,  # a sensor that jumps
    ],
)
def test_neither_noise_nor_a_step_nor_a_jump_of_a_sensor_is_a_motion(position) -> None:
    assert "joint_1 over" in refusal(position, np.zeros(SAMPLES))
