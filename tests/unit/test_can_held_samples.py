"""CAN samples that wait for a TIME frame when the link ends, or is cut: none of them is left out."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_protocol.can.frames import CanFrame, pack_frames
from firmware_protocol.can.mapping import time_interval
from host.links.transport import AnyChunk, Chunk, FrameChunk
from host.recording.load import assemble
from host.trial.live import Trial
from tests.can_traffic import object_at, sample_packets, sample_rows, timed

RATE_HZ = 200
PERIOD_NS = 5_000_000
GONE = range(600, 1100)
N_BEHIND = time_interval(RATE_HZ) - GONE.stop % time_interval(RATE_HZ) - 1
"""Samples behind the silence, one too few for the next TIME frame."""


@pytest.fixture(scope="module")
def frames() -> list[CanFrame]:
    """A long silence, a few samples, and no TIME frame behind them."""
    end = GONE.stop + N_BEHIND
    traffic = timed(object_at(rate_hz=RATE_HZ), sample_packets(end + 5, RATE_HZ), PERIOD_NS)
    rows = sample_rows(traffic)
    return traffic[: rows[GONE.start]] + [traffic[row] for row in rows[GONE.stop : end]]


def chunks_of(frames: list[CanFrame]) -> list[AnyChunk]:
    return [FrameChunk(pack_frames([frame]), frame.host_time_ns) for frame in frames]


def test_a_recording_that_ends_behind_a_silence_has_every_sample(frames: list[CanFrame]) -> None:
    trial = assemble(chunks_of(frames), "test")
    expected = [*range(GONE.start), *range(GONE.stop, GONE.stop + N_BEHIND)]
    assert N_BEHIND > 3
    assert trial.series.index.tolist() == expected
    assert trial.losses.lost == len(GONE)
    assert trial.counters.unnumbered == 0


def test_the_live_trial_has_the_same_when_it_is_finished(frames: list[CanFrame]) -> None:
    trial = Trial()
    received = sum(len(batch.stamps_ns) for chunk in chunks_of(frames) for batch in trial.feed(chunk).decoded)
    assert received == GONE.start
    rest = trial.finish()
    assert sum(len(batch.stamps_ns) for batch in rest.decoded) == N_BEHIND
    assert trial.assembler.losses().lost == len(GONE)
    assert trial.finish().items == []


def test_what_waits_when_the_link_is_cut_belongs_before_the_cut(frames: list[CanFrame]) -> None:
    again = timed(object_at(rate_hz=RATE_HZ), sample_packets(400, RATE_HZ, 1400, 7_000_100), PERIOD_NS, 9_000_000_000)
    cut = Chunk(b"", 8_900_000_000)
    trial = assemble([*chunks_of(frames), cut, *chunks_of(again)], "test")
    assert trial.reconnects == 1
    assert trial.counters.unnumbered == 0
    assert trial.series.index.tolist() == [
        *range(GONE.start),
        *range(GONE.stop, GONE.stop + N_BEHIND),
        *range(1400, 1800),
    ]
    live = Trial()
    for chunk in [*chunks_of(frames), cut, *chunks_of(again)]:
        live.feed(chunk)
    live.finish()
    assert live.assembler.losses() == trial.losses
    assert np.all(np.diff(trial.series.times_s) > 0)
