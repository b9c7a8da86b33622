"""Shifts in time against SciPy's."""

import numpy as np
import pytest
import scipy

from idim_iv_ros.signals.filters import shifted


@pytest.mark.parametrize("samples", [0.0, 0.3, 1.0, 4.7, -2.3])
def test_a_shift_is_that_of_scipy(samples: float) -> None:
    signal = np.cumsum(np.random.default_rng(1).normal(size=(500, 2)), axis=0)
    moved = shifted(signal, samples / 1000.0, 1000.0)
    expected = [scipy.ndimage.shift(line, samples, order=5, mode="nearest") for line in signal.T]
    # At the ends scipy repeats twelve samples less, which a spline forgets.
    np.testing.assert_allclose(moved, np.transpose(expected), rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(moved[30:-30], np.transpose(expected)[30:-30], atol=1e-12)
