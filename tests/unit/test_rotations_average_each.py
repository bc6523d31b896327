"""Averages of many groups at once against one group at a time."""

import numpy as np
import pytest

from analysis.geometry import averages, rotations


def test_groups_filled_up_with_anything_give_their_own_averages():
    rng = np.random.default_rng(3)
    sizes = rng.integers(1, 9, 50)
    quats = rng.normal(size=(50, 8, 4)) * 0.2 + rng.normal(size=(50, 1, 4))
    quats /= np.linalg.norm(quats, axis=2)[:, :, None]
    quats *= rng.choice([-1.0, 1.0], (50, 8, 1))
    weights = np.where(np.arange(8) < sizes[:, None], rng.uniform(0.1, 1.0, (50, 8)), 0.0)
    together = averages.average(quats, weights)
    assert together.shape == (50, 4)
    for k, size in enumerate(sizes):
        alone = averages.average(quats[k, :size], weights[k, :size])
        assert rotations.distance(together[k], alone) < 1e-12
        assert together[k, 0] >= 0.0


def test_no_groups():
    assert averages.average(np.empty((0, 3, 4)), np.empty((0, 3))).shape == (0, 4)
    with pytest.raises(ValueError, match="n >= 1"):
        averages.average(np.empty((3, 0, 4)))
