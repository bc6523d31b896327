"""Recordings read many chunks at a time against the same chunks taken one by one, as a live capture takes them."""

import random
import zlib
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.sample_streams import frame_rows, turning
from emulator.faults.definitions import FaultSettings
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Event, Info, OrientationBatch, Status
from firmware_protocol.serial.decoder import StreamDecoder
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk, GapChunk
from host.recording import format as fmt
from host.recording.bulk.raw_span import RawSpan
from host.recording.bulk.row_checksums import checksums
from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from host.recording.writer import RecordingWriter
from host.stream.decoding import Link
from host.stream.samples import SampleAssembler
from tests.clock_chunks import UnwrappedChunks
from tests.faulty_trials import faulty_chunks
from tests.joined_blocks import series_of
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario, virtual_chunks

DAMAGED = FaultSettings(
    bit_error_rate=2e-4,
    garbage_probability=0.02,
    drop_probability=0.02,
    duplicate_probability=0.02,
    reorder_probability=0.02,
)


@cache
def chunks_of(name):
    if name == "ideal":
        return virtual_chunks(scenario("ideal"), duration_s=12.0, chunk_s=0.004)[0]
    if name == "damaged":
        return faulty_chunks(replace(scenario("bad-cable", motion={"cycles": 4}), faults=DAMAGED), step_s=0.02)[0]
    return faulty_chunks(scenario(name), step_s=0.02)[0]


def one_by_one(chunks):
    """What a live capture makes of chunks."""
    link, assembler = Link(), SampleAssembler()
    blocks, events, temperatures_c, heard_ns = [], [], [], 0
    for chunk in chunks:
        items = link.feed(chunk)
        heard_ns = chunk.host_time_ns if chunk.data else heard_ns
        assembler.damaged(link.take_damage())
        blocks += assembler.feed(items, heard_ns)
        events += [assembler.locate_s(item, heard_ns) for item in items if isinstance(item, Event)]
        temperatures_c += [item.temperature_c for item in items if isinstance(item, Status)]
        if not chunk.data:
            assembler.reopened()
    blocks += assembler.release()
    return link, assembler, series_of(blocks, "x"), [time_s for time_s in events if time_s is not None], temperatures_c


@pytest.mark.parametrize("name", ["ideal", "damaged", "reset", "unplugged", "troubled", "ftdi", "clock-wrap"])
def test_a_recording_gives_what_the_capture_had(name, tmp_path):
    chunks = chunks_of(name)
    writer = RecordingWriter(tmp_path / "x.mcap", "memory:", WALL_NS, MONOTONIC_NS)
    for chunk in chunks:
        writer.add_received(chunk)
    writer.close()
    trial = load_trial(tmp_path / "x.mcap")
    link, assembler, series, events_s, temperatures_c = one_by_one(chunks)
    assert trial.counters == link.counters
    assert trial.losses == assembler.losses()
    assert trial.missing == tuple(assembler.missing_runs())
    assert trial.segments == tuple(assembler.segments)
    assert (trial.info, trial.status) == (assembler.info, assembler.status)
    assert [event.time_s for event in trial.events] == events_s
    np.testing.assert_array_equal(trial.temperatures_c, temperatures_c)
    for column in ("times_s", "quats_wxyz", "index"):
        np.testing.assert_array_equal(getattr(trial.series, column), getattr(series, column))
    assert len(series) > 500


@pytest.mark.parametrize("introduced", [True, False])
@pytest.mark.parametrize("away_us", [0, 200_000, 300_000, 5 * 10**6, -(10**8)])
def test_status_of_another_clock_among_samples_is_met_as_live(introduced, away_us, tmp_path):
    first = 20_000
    frames = frame_rows(turning(1200, 100.0), first, 10_000)
    writer, chunks = RecordingWriter(tmp_path / "x.mcap", "memory:", WALL_NS, MONOTONIC_NS), []
    for k, frame in enumerate(frames):
        said = [encode_frame(encode_packet(Info(device_id=7, boot_id=1)))] if introduced and k in {0, 900} else []
        if k % 40 == 7:  # one of them by another clock
            away = away_us if k == 607 else 0
            said.append(encode_frame(encode_packet(Status(10_000 * (first + k) + away, samples_produced=first + k))))
        chunks.append(Chunk(b"".join(said) + frame.tobytes(), MONOTONIC_NS + 10**9 + 10**7 * k))
        writer.add_received(chunks[-1])
    writer.close()
    trial = load_trial(tmp_path / "x.mcap")
    _, assembler, series, _, _ = one_by_one(chunks)
    assert trial.losses == assembler.losses()
    assert trial.segments == tuple(assembler.segments)
    assert trial.status == assembler.status
    np.testing.assert_array_equal(trial.series.times_s, series.times_s)
    np.testing.assert_array_equal(trial.series.index, series.index)


@given(seed=st.integers(0, 2**32), n_hits=st.integers(0, 12), cut=st.booleans())
@settings(derandomize=True, deadline=None, max_examples=25)
def test_of_a_damaged_file_the_same_chunks_are_left(seed, n_hits, cut, tmp_path_factory):
    rng = random.Random(seed)
    path = tmp_path_factory.mktemp("damaged") / "x.mcap"
    writer = RecordingWriter(path, "memory:", WALL_NS, MONOTONIC_NS)
    now_ns = MONOTONIC_NS
    for _ in range(400):
        size = rng.choice([21, 21, 21, 42, 63, 0, rng.randrange(1, 3000)])
        now_ns += rng.randrange(10**7)
        writer.add_received(Chunk(rng.randbytes(size), now_ns))
        if rng.random() < 0.1:
            writer.add_sent(rng.randbytes(9), now_ns)
    writer.close()
    data = bytearray(path.read_bytes())
    header = data.index(b"rotdrift_msgs") + 4000  # the recording's own description is another matter
    for _ in range(n_hits):
        data[rng.randrange(header, len(data))] ^= rng.randrange(1, 256)
    path.write_bytes(data[: rng.randrange(header, len(data))] if cut else data)
    single, together = RecordingReader(path), RecordingReader(path)
    expected, found = [], []
    for message in single.messages({fmt.RECEIVED}):
        try:
            expected.append(fmt.decode_raw(message.data))
        except fmt.DamagedMessageError as error:
            single.note_damaged(fmt.RECEIVED, error)
    for item in together.spans():
        found += item.chunks() if isinstance(item, RawSpan) else [item]
    assert [chunk for chunk in found if not isinstance(chunk, GapChunk)] == expected
    assert list(together.chunks()) == expected
    assert together.damage == single.damage


@given(seed=st.integers(0, 2**32), size=st.sampled_from([1, 20, 500, 5000, 10**6]))
@settings(derandomize=True, deadline=None, max_examples=15)
def test_the_place_of_every_packet_is_that_of_its_delimiter(seed, size):
    rng = random.Random(seed)
    data = bytearray(b"".join(chunk.data for chunk in chunks_of("damaged")))
    del data[rng.randrange(20_000) :]
    for _ in range(rng.randrange(200)):
        data[rng.randrange(len(data))] = rng.choice([0, 0, rng.randrange(256)])
    single, expected = StreamDecoder(), []
    for at in range(len(data)):  # byte by byte: what comes is what this byte completed
        for item in single.feed(bytes(data[at : at + 1])):
            expected.append((at, describe(item, 0)))
    located, found = StreamDecoder(), []
    for start in range(0, len(data), size):
        packets = located.feed_located(bytes(data[start : start + size]))
        ends, others = packets.ends.tolist(), {id(packet): end for _, packet, end in packets.others}
        for item in packets.items():
            if isinstance(item, OrientationBatch):
                found += [(start + ends.pop(0), describe(item, k)) for k in range(len(item))]
            else:
                found.append((start + others[id(item)], describe(item, 0)))
    assert found == expected
    assert located.counters == single.counters


def describe(item, k):
    if not isinstance(item, OrientationBatch):
        return repr(item)
    return (int(item.sequence[k]), int(item.device_time_us[k]), item.quats_wxyz[k].tobytes(), int(item.flags[k]))


@given(
    seed=st.integers(0, 2**32), n=st.integers(1, 400), trouble=st.sampled_from(["none", "late", "step", "gap", "old"])
)
@settings(derandomize=True, deadline=None, max_examples=60)
def test_the_device_clock_unwrapped_at_once_is_that_of_chunk_by_chunk(seed, n, trouble):
    rng = np.random.default_rng(seed)
    device_us = rng.integers(0, 2**32) + np.cumsum(rng.integers(500, 20_000, n))
    if trouble == "step":
        device_us[n // 2 :] += rng.integers(-(10**8), 10**8)
    if trouble == "late":
        device_us = device_us[np.argsort(np.arange(n) + rng.uniform(0, 3, n))]
    host_ns = 10**15 + 1000 * (device_us - device_us[0]) + rng.integers(0, 30_000_000, n)
    if trouble == "gap":
        host_ns[n // 2 :] += 10**11
    if trouble == "old":
        host_ns[n // 2 :] -= 10**9
    host_ns = np.maximum.accumulate(host_ns // 5_000_000 * 5_000_000)
    ticks = (device_us % 2**32).astype(np.uint32)
    single, many = UnwrappedChunks(), UnwrappedChunks()
    start = 0
    for part in np.array_split(np.arange(n), rng.integers(1, 5)):
        if not len(part):
            continue
        unwrapped = many.clock.unwrap_many(ticks[part], host_ns[part])
        expected = []
        for k in np.split(part, np.flatnonzero(np.diff(host_ns[part])) + 1):
            expected += single.feed(ticks[k], int(host_ns[k[0]])).tolist()
            if unwrapped is None:
                many.feed(ticks[k], int(host_ns[k[0]]))
        if unwrapped is not None:
            assert unwrapped.tolist() == expected
            assert start > 0, "the first chunk begins a segment"
            assert not single.take_steps()
        assert (many.newest_us, many.segment) == (single.newest_us, single.segment)
        later_ns = int(host_ns[part[-1]]) + 10**7
        now = int(ticks[part[-1]])
        assert many.locate(now, later_ns) == single.locate(now, later_ns)
        many.take_steps(), single.take_steps()
        start += len(part)


@pytest.mark.parametrize("longest", [0, 1, 2, 30, 40, 300])
@pytest.mark.parametrize("n", [0, 1, 256, 300, 5000])
@pytest.mark.parametrize("k", [4, 9])
def test_checksums_of_many_strings_are_those_of_zlib(n, longest, k):
    rng = np.random.default_rng(n + longest)
    data = rng.bytes(2 * longest + 50)
    starts = rng.integers(0, longest + 50, n)
    ends = starts + rng.integers(0, longest + 1, n)
    prefixes = rng.integers(0, 256, (n, k), dtype=np.uint8)
    given_prefixes = prefixes.copy()
    expected = [
        zlib.crc32(prefix.tobytes() + data[start:end])
        for prefix, start, end in zip(prefixes, starts, ends, strict=True)
    ]
    assert checksums(prefixes, memoryview(data), starts, ends).tolist() == expected
    np.testing.assert_array_equal(prefixes, given_prefixes)
