"""Samples gathered into one series: whatever is said of how many will come, none is lost."""

import numpy as np
import pytest

from host.stream.blocks import SampleBlock
from host.stream.series import FIRST_SAMPLES, SampleGatherer


def blocks(n, size):
    rng = np.random.default_rng(n)
    quats = rng.normal(size=(n, 4))
    quats /= np.linalg.norm(quats, axis=1)[:, None]
    for first in range(0, n, size):
        index = np.arange(first, min(first + size, n))
        part = quats[first : first + size]
        yield SampleBlock(index, index / 1000.0, part, np.zeros(len(index), np.uint8), 0)


@pytest.mark.parametrize("share", [0.0, 1e-9, 0.2, 0.5, 0.99, 1.0])
@pytest.mark.parametrize("size", [5_000, 3 * FIRST_SAMPLES])
def test_room_is_made_whatever_share_is_said_to_have_come(share, size):
    n = 4 * FIRST_SAMPLES + 7
    gatherer = SampleGatherer(lambda: share)
    gatherer.add(blocks(n, size))
    series = gatherer.series("test")
    np.testing.assert_array_equal(series.index, np.arange(n))
    np.testing.assert_array_equal(series.times_s, np.arange(n) / 1000.0)
    expected = np.concatenate([block.quats_wxyz for block in blocks(n, size)])
    np.testing.assert_allclose(series.quats_wxyz, expected, atol=1e-15)
    assert len(gatherer._index) <= 17 * n


def test_the_share_read_of_a_recording_rises_to_all_of_it(tmp_path):
    from benchmarks.large_recordings import write_large
    from host.recording.reader import RecordingReader

    path = tmp_path / "x.mcap"
    write_large(path, 60_000)
    reader = RecordingReader(path)
    shares = [reader.share_read() for _ in reader.spans()]
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert 0.5 < shares[-1] < 1.0
    assert len(shares) > 2
