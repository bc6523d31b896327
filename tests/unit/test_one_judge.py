"""A reset, a step of the clock, numbers that start again: every part names the same place, live and offline."""

from dataclasses import dataclass

import numpy as np
import pytest

from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Info, Orientation
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk
from host.recording.load import assemble
from host.stream.blocks import RESET, RESTARTED, STEPPED
from host.stream.session import Phase, Session, SessionSettings
from host.trial.live import Trial

START_NS = 40_000_000_000_000
PERIOD_US = 10_000
N = 3000
PLACE = 1502
"""The first sample behind the change: in the middle of a chunk."""
CHUNK = 7
AHEAD_US = 20_000_000


@dataclass(frozen=True)
class Change:
    """What happens to the object before sample :data:`PLACE`."""

    reason: str
    clock_us: int
    """What its clock reads then, less what it would have."""
    numbers_restart: bool
    known: bool = False
    """Whether it introduced itself at first."""
    info_after: int | None = None
    """So many samples behind the change it introduces itself with another boot id."""


CHANGES = {
    "INFO with another boot id": Change(RESET, -PLACE * PERIOD_US, True, known=True, info_after=0),
    "INFO late, after samples of the new life": Change(RESET, -PLACE * PERIOD_US, True, known=True, info_after=5),
    "reset of an object that never answers": Change(RESTARTED, -PLACE * PERIOD_US, True),
    "clock step forward": Change(STEPPED, AHEAD_US, False),
    "clock step back": Change(STEPPED, -AHEAD_US // 2, False),
    "clock step of an object that answers": Change(STEPPED, AHEAD_US, False, known=True),
    "small step back, within what may be late": Change(STEPPED, -300_000, False),
    "numbers and clock start again elsewhere": Change(RESTARTED, AHEAD_US, True),
}


def frame(packet):
    return encode_frame(encode_packet(packet))


def chunks_with(change):
    """Samples every 10 ms, seven a chunk, each chunk delivered with its newest sample."""
    frames = []
    for k in range(N):
        changed = k >= PLACE
        number = k - PLACE if changed and change.numbers_restart else k
        clock_us = 60_000_000 + k * PERIOD_US + (change.clock_us if changed else 0)
        frames.append(frame(Orientation(number % 65536, clock_us % 2**32, (1.0, 0.0, 0.0, 0.0))))
    if change.info_after is not None:
        at = PLACE + change.info_after
        frames[at] = frame(Info(device_id=7, boot_id=2)) + frames[at]
    if change.known:
        frames[0] = frame(Info(device_id=7, boot_id=1)) + frames[0]
    return [
        Chunk(b"".join(frames[first : first + CHUNK]), START_NS + min(first + CHUNK, N) * 1000 * PERIOD_US)
        for first in range(0, N, CHUNK)
    ]


@pytest.fixture(params=CHANGES, ids=lambda name: name.replace(" ", "-"))
def change(request):
    return CHANGES[request.param]


class Live:
    """A trial and a session, fed as a capture feeds them, and what each made of every sample."""

    def __init__(self, chunks):
        self.trial, self.decided = Trial(), []
        self.session = Session(SessionSettings(), "memory:", START_NS)
        self.session.phase = Phase.STREAMING
        assembler = self.trial.assembler
        assembler.on_segment.append(self.session.new_segment)
        assembler.on_segment.append(self.decided.append)
        self.sample_segment, self.clock_segment = [], []
        assembler.on_samples.append(self._note)
        for chunk in chunks:
            update = self.trial.feed(chunk)
            self.session.feed(update.items, len(chunk.data), chunk.host_time_ns)

    def _note(self, samples):
        n = len(samples.device_time_us)
        self.sample_segment += [len(self.trial.assembler.segments) - 1] * n
        self.clock_segment += [self.trial.clock_estimate.segment] * n


EXPECTED = [0] * PLACE + [1] * (N - PLACE)


def test_live_every_part_names_the_same_place(change):
    live = Live(chunks_with(change))
    losses = live.trial.assembler.losses()
    assert live.decided == [change.reason]
    assert live.sample_segment == EXPECTED
    assert live.clock_segment == EXPECTED
    assert [segment.reason for segment in live.trial.assembler.segments[1:]] == [change.reason]
    # An account that closed one sample too early or too late would miss some, or find some twice.
    assert (losses.produced, losses.received, losses.duplicates) == (N, N, 0)
    assert losses.segments == (2 if change.numbers_restart else 1)
    was_reset = change.reason == RESET
    assert live.session.warnings == ["the object was reset during the capture"] * was_reset
    assert (live.session.phase is Phase.STARTING) == was_reset


def test_offline_every_part_names_the_place_that_it_has_live(change):
    chunks = chunks_with(change)
    live, trial = Live(chunks), assemble(chunks, "x")
    assert list(trial.segments) == live.trial.assembler.segments
    assert trial.losses == live.trial.assembler.losses()
    assert [segment.samples for segment in trial.clock.segments] == [PLACE, N - PLACE]
    assert len(trial.clock.steps) == (0 if change.reason == RESET else 1)
    # Of the time axis only the step to the new segment is the host's.
    steps_s = np.diff(trial.series.times_s)
    assert np.delete(steps_s, PLACE - 1) == pytest.approx(np.full(N - 2, 0.01), abs=1e-9)
    assert trial.series.times_s[PLACE] == trial.segments[1].time_s


def test_a_reset_tells_the_session_once_however_often_it_introduces_itself():
    change = CHANGES["INFO with another boot id"]
    chunks = chunks_with(change)
    again = Chunk(frame(Info(device_id=7, boot_id=2)), chunks[-1].host_time_ns)
    live = Live([*chunks, again, again])
    assert live.decided == [RESET]
    assert len(live.session.warnings) == 1
