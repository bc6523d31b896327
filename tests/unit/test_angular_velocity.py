"""Smoothing in the frequency domain against scipy's, sample by sample."""

import numpy as np
import pytest
from scipy import ndimage

from analysis.cycles.motion import Motion


@pytest.mark.parametrize("n", [400, 5000, 70_001])
@pytest.mark.parametrize("sigma", [2.0, 5.0, 12.0, 50.0])
def test_smoothing_is_that_of_scipy(n, sigma):
    rng = np.random.default_rng(n)
    omega = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    smooth = Motion(0.0, 100.0, omega, np.ones(n), 0.1).smoothed(sigma / 100.0).omega
    expected = ndimage.gaussian_filter1d(omega, sigma, axis=0, mode="nearest")
    np.testing.assert_allclose(smooth, expected, rtol=0, atol=1e-13 * np.abs(omega).max())
