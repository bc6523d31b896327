"""The live clock of a trial: samples on the host's time, over wraps, resets, reboots and round trips."""

import numpy as np
import pytest

from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Info, Orientation
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk
from host.stream.round_trips import RoundTrip
from host.trial.live import Trial

MODULUS = 2**32
S = 1_000_000
HOST_NS = 55_555_000_000_000
FIRST_US = MODULUS - 5 * S  # wraps after five seconds


class Wire:
    """Encodes ticks as samples of one object, numbered on."""

    def __init__(self):
        self.trial = Trial()
        self._number = 0

    def feed(self, ticks, arrival_ns):
        """One chunk; return the host times of its samples."""
        data = b""
        for tick in ticks:
            packet = Orientation(self._number % 65536, int(tick) % MODULUS, (1.0, 0.0, 0.0, 0.0))
            data += encode_frame(encode_packet(packet))
            self._number += 1
        decoded = self.trial.feed(Chunk(data, arrival_ns)).decoded
        return [batch.stamps_ns for batch in decoded]

    def reset(self, boot_id, arrival_ns):
        self._number = 0
        self.introduce(boot_id, arrival_ns)

    def introduce(self, boot_id, arrival_ns):
        info = Info(device_id=7, boot_id=boot_id)
        self.trial.feed(Chunk(encode_frame(encode_packet(info)), arrival_ns))

    def run(self, start_s, stop_s, origin_us=FIRST_US):
        """Chunks of two samples 10 ms apart, delivered 1 ms after the second; a device that is 50 ppm fast."""
        out = []
        for k in range(round(start_s * 50), round(stop_s * 50)):
            seconds = np.array([0.02 * k, 0.02 * k + 0.01])
            ticks = origin_us + np.rint(1e6 * seconds * 1.00005).astype(np.int64)
            out.append((seconds, self.feed(ticks, HOST_NS + round(1e9 * (seconds[1] + 0.001)))))
        return out

    @property
    def segments(self):
        return self.trial.clock_values().segments


def test_mapping_over_the_wrap():
    wire = Wire()
    for seconds, (stamps_ns,) in wire.run(0.0, 40.0)[1000:]:
        assert (stamps_ns - HOST_NS) / 1e9 - 0.001 == pytest.approx(seconds, abs=5e-6)
    assert wire.segments == 1
    estimate = wire.trial.clock_estimate
    assert estimate.skew_ppm == pytest.approx(50.0, abs=0.3)
    assert estimate.reference_us > MODULUS


def test_a_reset_inside_a_chunk_splits_it():
    wire = Wire()
    wire.run(0.0, 30.0)
    old = (FIRST_US + round(30e6 * 1.00005)) % MODULUS
    before, after = wire.feed([old, 1_000, 11_000], HOST_NS + 30_031_000_000)
    assert (before[0] - HOST_NS) / 1e9 == pytest.approx(30.001, abs=5e-6)
    assert np.diff(after) == pytest.approx(10_000_000, abs=1_000)
    assert wire.segments == 2


def test_a_step_too_small_for_the_unwrapper_restarts_the_estimate():
    wire = Wire()
    wire.run(0.0, 30.0)
    seconds, (stamps_ns,) = wire.run(30.0, 35.0, origin_us=FIRST_US + 200_000)[-1]
    assert wire.segments == 2
    assert len(wire.trial.assembler.segments) == 1  # the samples' own time goes on
    assert (stamps_ns - HOST_NS) / 1e9 - 0.001 == pytest.approx(seconds, abs=5e-6)


def test_boot_id():
    wire = Wire()
    wire.introduce(7, HOST_NS)
    wire.run(0.0, 1.0)
    wire.introduce(7, HOST_NS + 10**9)
    assert wire.segments == 1
    wire.reset(8, HOST_NS + 10**9)
    assert wire.trial.clock_estimate is None
    wire.run(1.0, 1.1, origin_us=0)
    assert wire.segments == 2
    assert [segment.reason for segment in wire.trial.assembler.segments[1:]] == ["the object was reset"]


def test_a_link_that_is_opened_again_starts_a_segment_of_the_clock():
    wire = Wire()
    wire.trial.feed(Chunk(b"", HOST_NS))
    wire.run(0.0, 0.1)
    assert wire.segments == 1  # there was nothing before
    for _ in range(2):
        wire.trial.feed(Chunk(b"", HOST_NS + 10**8))
    assert wire.trial.clock_estimate is None
    wire.run(0.1, 0.2)
    assert wire.segments == 2


def test_round_trip_with_wrapped_or_whole_uptime():
    wire = Wire()
    wire.run(0.0, 20.0)
    for uptime in (FIRST_US + round(20e6 * 1.00005), (FIRST_US + round(20e6 * 1.00005)) % MODULUS):
        sent = HOST_NS + 20_000_000_000 - 700_000
        wire.trial.feed_round_trips([RoundTrip(sent, uptime, uptime + 100, sent + 1_600_000)])
    estimate = wire.trial.clock_estimate
    assert wire.segments == 1
    assert estimate.interval.n_round_trips == 2
    assert estimate.interval.low_ns < estimate.offset_ns - 1_000_000 < estimate.interval.high_ns


def test_round_trip_of_another_life_is_ignored():
    wire = Wire()
    wire.trial.feed_round_trips([RoundTrip(HOST_NS, 5, 6, HOST_NS + 1000)])
    assert wire.trial.clock_estimate is None
    wire.run(0.0, 20.0)
    wire.trial.feed_round_trips([RoundTrip(HOST_NS, 900 * S, 900 * S + 10, HOST_NS + 20_000_000_000)])
    assert wire.trial.clock_estimate.interval.n_round_trips == 0


def test_round_trip_that_proves_a_step():
    wire = Wire()
    wire.run(0.0, 20.0)
    late = FIRST_US + 20 * S - 400_000
    sent = HOST_NS + 20_000_000_000
    wire.trial.feed_round_trips([RoundTrip(sent, late, late + 100, sent + 1_000_000)])
    assert wire.trial.clock_estimate is None
    wire.run(20.02, 20.1)
    assert wire.segments == 2
