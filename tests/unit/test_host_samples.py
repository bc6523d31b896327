"""From packets to samples: wraps, resets, repeated and late samples, and the same answer for any chunks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Event, EventKind, Info, Orientation, OrientationBatch, Status
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk, joined
from host.stream.decoding import Link, grouped
from host.stream.samples import SampleAssembler
from tests.joined_blocks import series_of

PERIOD_US = 5000


def batch(numbers, start_us=0, period_us=PERIOD_US):
    numbers = np.asarray(list(numbers), dtype=np.int64)
    half = numbers * 1e-3
    return OrientationBatch(
        sequence=(numbers % 65536).astype(np.uint16),
        device_time_us=((start_us + numbers * period_us) % 2**32).astype(np.uint32),
        quats_wxyz=np.column_stack([np.cos(half), np.sin(half), 0 * half, 0 * half]),
        flags=np.zeros(len(numbers), dtype=np.uint8),
    )


def host_ns(numbers, start_ns=10**12):
    return start_ns + int(list(numbers)[-1]) * PERIOD_US * 1000


def assembled(*feeds):
    """Feeds are (items, host time)."""
    assembler = SampleAssembler()
    blocks = [block for items, at_ns in feeds for block in assembler.feed(items, at_ns)]
    return assembler, blocks


def test_time_begins_at_the_first_sample_and_runs_on_the_devices_clock():
    _, blocks = assembled(([batch(range(100, 110))], host_ns(range(110))))
    np.testing.assert_allclose(blocks[0].time_s, np.arange(10) * 0.005, atol=1e-12)
    assert blocks[0].index.tolist() == list(range(100, 110))


def test_the_wrap_of_both_counters_changes_nothing():
    start_us = 2**32 - 700 * PERIOD_US - 65000 * PERIOD_US
    numbers = range(65000, 67000)
    feeds = [
        ([batch(numbers[at : at + 7], start_us)], host_ns(numbers[at : at + 7])) for at in range(0, len(numbers), 7)
    ]
    assembler, blocks = assembled(*feeds)
    series = series_of(blocks, "test")
    assert len(assembler.segments) == 1
    np.testing.assert_allclose(series.times_s, np.arange(2000) * 0.005, atol=1e-9)
    np.testing.assert_array_equal(series.index, np.arange(65000, 67000))
    assert assembler.losses().missing == 0


def test_a_reset_told_by_another_boot_id_begins_a_segment_placed_by_the_host_clock():
    first, second = range(1000, 1100), range(50)
    later_ns = host_ns(first) + 2_000_000_000
    assembler, blocks = assembled(
        ([Info(device_id=1, boot_id=1), batch(first)], host_ns(first)),
        ([Info(device_id=1, boot_id=2), batch(second)], later_ns),
    )
    series = series_of(blocks, "test")
    assert [segment.reason for segment in assembler.segments] == ["the capture began", "the object was reset"]
    assert series.times_s[100] == pytest.approx(2.0, abs=1e-6)
    assert (np.diff(series.index) > 0).all()
    assert assembler.losses().missing == 0
    assert assembler.losses().segments == 2


def test_a_reset_nobody_told_of_is_seen_from_clock_and_numbers():
    first, second = range(40_000, 40_100), range(3, 50)
    later_ns = host_ns(first) + 800_000_000
    assembler, blocks = assembled(([batch(first)], host_ns(first)), ([batch(second)], later_ns))
    assert len(assembler.segments) == 2
    assert assembler.losses().missing == 0
    assert [len(block) for block in blocks] == [100, 47]


def test_a_step_of_the_device_clock_does_not_invent_losses():
    first, second = range(100), range(110, 200)
    assembler, blocks = assembled(
        ([batch(first)], host_ns(first)), ([batch(second, start_us=3_000_000_000)], host_ns(second[:1]))
    )
    assert [segment.reason for segment in assembler.segments] == ["the capture began", "the device clock stepped"]
    assert assembler.losses().missing == 10
    assert assembler.losses().segments == 1
    assert series_of(blocks, "test").index.tolist() == [*range(100), *range(110, 200)]


@pytest.mark.parametrize("at_once", [1, 7, 200])
def test_a_small_step_back_of_the_device_clock_costs_no_sample(at_once):
    numbers = np.arange(200)
    times_us = numbers * PERIOD_US - np.where(numbers >= 100, 150_000, 0) + 400_000
    assembler, blocks = SampleAssembler(), []
    for start in range(0, 200, at_once):
        piece = slice(start, start + at_once)
        quats = np.tile([1.0, 0.0, 0.0, 0.0], (len(numbers[piece]), 1))
        flags = np.zeros(len(quats), np.uint8)
        part = OrientationBatch(numbers[piece].astype(np.uint16), times_us[piece].astype(np.uint32), quats, flags)
        blocks += assembler.feed([part], int(10**12 + numbers[piece][-1] * PERIOD_US * 1000))
    assert [segment.reason for segment in assembler.segments] == ["the capture began", "the device clock stepped"]
    series = series_of(blocks, "test")
    assert series.index.tolist() == numbers.tolist()
    assert (assembler.losses().received, assembler.losses().missing, assembler.losses().segments) == (200, 0, 1)


def test_late_samples_are_put_where_they_belong_and_repeated_ones_dropped():
    assembler, blocks = assembled(
        ([batch([0, 1, 2, 4, 5])], host_ns([5])),
        ([batch([5, 3, 6])], host_ns([6])),
        ([batch([6, 7])], host_ns([7])),
    )
    series = series_of(blocks, "test")
    assert series.index.tolist() == list(range(8))
    np.testing.assert_allclose(series.times_s, np.arange(8) * 0.005, atol=1e-12)
    losses = assembler.losses()
    assert (losses.received, losses.missing, losses.duplicates, losses.reordered) == (8, 0, 2, 1)


def test_numbers_count_from_what_status_said():
    assembler, blocks = assembled(
        ([Status(uptime_us=0, samples_produced=200_000), batch(range(200_002, 200_010))], 10**12),
    )
    assert blocks[0].index[0] == 200_002
    assert assembler.losses().missing == 2


def test_events_lie_on_the_same_time_axis():
    assembler, _ = assembled(([batch(range(100))], host_ns(range(100))))
    assert assembler.locate_s(Event(50 * PERIOD_US, EventKind.MARKER), host_ns(range(100))) == pytest.approx(0.25)
    assert SampleAssembler().locate_s(Event(0, EventKind.MARKER), 0) is None


def test_nothing_received_is_an_empty_series():
    assert len(series_of([], "test")) == 0


WIRE = b"".join(
    [encode_frame(encode_packet(Info(device_id=7, boot_id=1)))]
    + [
        encode_frame(
            encode_packet(
                Status(uptime_us=n * PERIOD_US, samples_produced=n)
                if n % 20 == 0 and half
                else Orientation(n % 65536, (2**32 - 100_000 + n * PERIOD_US) % 2**32, (0.6, 0.8, 0.0, 0.0))
            )
        )
        for n in range(65_500, 65_600)
        for half in (False, True)
        if not half or n % 20 == 0
    ]
)


def samples_of(chunks):
    link, assembler = Link(), SampleAssembler()
    blocks = [block for chunk in chunks for block in assembler.feed(link.feed(chunk), chunk.host_time_ns)]
    return series_of(blocks, "test"), assembler.losses()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 200), min_size=1, max_size=80), st.integers(0, len(WIRE) - 1), st.integers(0, 255))
def test_samples_do_not_depend_on_how_the_bytes_are_cut(cuts, damaged_at, damage):
    data = bytearray(WIRE)
    data[damaged_at] ^= damage
    chunks, at = [], 0
    for n, cut in enumerate(cuts):
        end = len(data) if n == len(cuts) - 1 else at + cut
        if data[at:end]:
            chunks.append(Chunk(bytes(data[at:end]), 10**12 + at * 100_000))
        at = end
    one, losses = samples_of(chunks)
    other, other_losses = samples_of(map(joined, grouped(chunks)))
    np.testing.assert_array_equal(one.times_s, other.times_s)
    np.testing.assert_array_equal(one.index, other.index)
    np.testing.assert_array_equal(one.quats_wxyz, other.quats_wxyz)
    assert losses == other_losses
    assert losses.received >= 97  # one byte hurts two frames at most
