"""Parallel decimation against SciPy's own, and chunk by chunk against the whole."""

import numpy as np
import pytest
from scipy.signal import cheby1, decimate, sosfiltfilt

from idim_iv_ros.signals import central_differences, zero_phase_butterworth
from idim_iv_ros.signals.decimation import ParallelDecimation, common_factors, decimation_factor


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
    np.testing.assert_array_equal(ParallelDecimation(4, samples, 0.9).whole(signal), expected)


RATE = 1000.0
TIME = np.arange(4000) / RATE


def test_gain_at_the_cutoff_is_one_half_after_two_passes() -> None:
    sine = np.sin(2 * np.pi * 50.0 * TIME)[:, None]
    filtered = zero_phase_butterworth(sine, rate=RATE, cutoff=50.0, order=4)
    assert np.abs(filtered[1000:3000]).max() == pytest.approx(0.5, rel=1e-3)


def test_differences_of_a_parabola_are_exact_inside() -> None:
    velocity, acceleration = central_differences((3.0 * TIME**2)[:, None], rate=RATE)
    np.testing.assert_allclose(velocity[1:-1, 0], 6.0 * TIME[1:-1], atol=1e-9)
    np.testing.assert_allclose(acceleration[2:-2, 0], 6.0, atol=1e-6)


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
