"""Zero-phase filtering and central differences."""

import numpy as np
import pytest

from idim_iv_ros.signals import central_differences, zero_phase_butterworth

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
