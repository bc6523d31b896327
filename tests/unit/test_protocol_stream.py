"""The stream decoder: what it delivers, how it groups, what it counts."""

import dataclasses
import math
import random
import struct

import numpy as np
import pytest

from firmware_protocol import codec, quantization
from firmware_protocol.items import ForeignInfo
from firmware_protocol.packets import GetInfo, Orientation, OrientationBatch, PacketType, Status
from firmware_protocol.serial import decoder as stream
from firmware_protocol.serial.decoder import StreamDecoder, encode_command
from firmware_protocol.serial.framing import encode_frame
from tests.wire_streams import (
    assert_accounted,
    assert_same,
    decode_fast,
    decode_slowly,
    frame,
    odd_frames,
    orientation,
    other_packets,
)

BOTH_WAYS = pytest.mark.parametrize("batch_bytes", [1, 10**9], ids=["together", "one by one"])


@pytest.fixture
def rng():
    return random.Random(20)


@BOTH_WAYS
def test_runs_of_samples_come_as_batches_in_wire_order(batch_bytes, rng, monkeypatch):
    monkeypatch.setattr(stream, "BATCH_BYTES", batch_bytes)
    samples = [orientation(k, rng) for k in range(65530, 65540)]
    status = Status(7, temperature_c=20.0)
    content = b"".join(map(frame, [*samples[:4], status, *samples[4:]])) + b"\x05noise\0"
    first, middle, last = StreamDecoder().feed(content)
    assert isinstance(first, OrientationBatch)
    assert isinstance(last, OrientationBatch)
    assert middle == status
    assert (len(first), len(last)) == (4, 6)
    assert last.sequence.tolist() == [65534, 65535, 0, 1, 2, 3]
    assert last.device_time_us.tolist() == [sample.device_time_us for sample in samples[4:]]
    assert last.flags.tolist() == [int(sample.flags) for sample in samples[4:]]
    assert np.abs(last.quats_wxyz - [sample.q_wxyz for sample in samples[4:]]).max() < 3.1e-5
    assert np.abs(np.linalg.norm(last.quats_wxyz, axis=1) - 1.0).max() < 5e-16


@BOTH_WAYS
def test_samples_equal_those_of_the_codec_to_the_last_bit(batch_bytes, rng, monkeypatch):
    monkeypatch.setattr(stream, "BATCH_BYTES", batch_bytes)
    packets = [codec.encode_packet(orientation(k, rng)) for k in range(500)]
    (batch,) = StreamDecoder().feed(b"".join(map(encode_frame, packets)))
    expected = [codec.decode_packet(packet) for packet in packets]
    columns = (batch.sequence, batch.device_time_us, batch.quats_wxyz, batch.flags)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    assert [Orientation(s, t, tuple(q), f) for s, t, q, f in rows] == expected


@BOTH_WAYS
def test_damage_among_samples_does_not_cut_a_batch(batch_bytes, rng, monkeypatch):
    monkeypatch.setattr(stream, "BATCH_BYTES", batch_bytes)
    frames = [frame(orientation(k, rng)) for k in range(30)]
    frames[4] = frames[4][:5] + b"\x77" + frames[4][6:]
    frames[9] = odd_frames()[0]
    (batch,) = StreamDecoder().feed(b"".join(frames))
    assert batch.sequence.tolist() == [k for k in range(30) if k not in (4, 9)]


@BOTH_WAYS
def test_everything_odd_is_counted_by_kind(batch_bytes, monkeypatch):
    monkeypatch.setattr(stream, "BATCH_BYTES", batch_bytes)
    decoder = StreamDecoder()
    items = decoder.feed(b"".join(odd_frames()))
    counters = decoder.counters
    assert items[0] == ForeignInfo(2, 0)
    assert counters.unknown_types == 2
    assert counters.unsupported_versions == 1
    assert counters.malformed == 4
    assert counters.extended == 2
    assert counters.packets == {PacketType.ORIENTATION: 1, PacketType.STATUS: 1}
    assert counters.frames == 9


@BOTH_WAYS
def test_all_samples_of_a_newer_minor_version_are_read(batch_bytes, rng, monkeypatch):
    monkeypatch.setattr(stream, "BATCH_BYTES", batch_bytes)
    content = b"".join(encode_frame(codec.encode_packet(orientation(k, rng)) + b"newer\0") for k in range(300))
    decoder = StreamDecoder()
    (batch,) = decoder.feed(content)
    assert batch.sequence.tolist() == list(range(300))
    assert decoder.counters.extended == 300


def four_squares(total):
    """Four integers whose squares add up to ``total``, the first two about as large."""
    for w in range(math.isqrt(total // 2), 0, -1):
        if (total - w * w) % 8 == 7:
            continue  # no sum of three squares (Legendre)
        for x in range(math.isqrt(total - w * w), -1, -1):
            rest = total - w * w - x * x
            for y in range(math.isqrt(rest), math.isqrt(rest // 2) - 1, -1):
                z = math.isqrt(rest - y * y)
                if y * y + z * z == rest:
                    return w, x, y, z
    raise AssertionError(total)


@pytest.mark.parametrize("batch_bytes", [1, 10**9], ids=["together", "one by one"])
@pytest.mark.parametrize(
    ("square", "taken"),
    [
        (quantization.Q15_MIN_SQUARE - 1, False),
        (quantization.Q15_MIN_SQUARE, True),
        (quantization.Q15_MAX_SQUARE, True),
        (quantization.Q15_MAX_SQUARE + 1, False),
    ],
)
def test_the_tolerance_of_the_norm_ends_where_it_says(square, taken, batch_bytes, monkeypatch):
    monkeypatch.setattr(stream, "BATCH_BYTES", batch_bytes)
    sample = encode_frame(struct.pack("<BHI4hB", PacketType.ORIENTATION, 1, 2, *four_squares(square), 0))
    for n in (1, 2):
        decoded = decode_fast(n * sample)
        assert (len(decoded.items), decoded.counted["malformed"]) == ((n, 0) if taken else (0, n))


@pytest.mark.parametrize("extra", [-1, 0, 1, 2], ids=lambda extra: f"{extra:+d} bytes")
@pytest.mark.parametrize("before", [b"", b"\0", b"\0\0"], ids=len)
@pytest.mark.parametrize("behind", [b"\0", b"\0\0"], ids=len)
def test_a_frame_that_comes_alone_is_what_it_is_among_others(extra, before, behind, rng):
    packet = codec.encode_packet(orientation(5, rng))
    piece = encode_frame(packet[:extra] if extra < 0 else packet + bytes(extra)).strip(b"\0")
    alone, among = StreamDecoder(), StreamDecoder()
    got = alone.feed(before + piece + behind)
    expected = among.feed(before + piece + behind + encode_frame(b"\xee" * 30))
    assert [item.sequence.tolist() for item in got] == [item.sequence.tolist() for item in expected]
    assert alone.counters.packets == among.counters.packets
    assert (alone.counters.extended, alone.counters.malformed) == (among.counters.extended, among.counters.malformed)
    assert alone.counters.delimiters == len(before) + len(behind)


def test_samples_of_two_lengths_keep_their_order(rng, monkeypatch):
    monkeypatch.setattr(stream, "BATCH_BYTES", 1)
    packets = [codec.encode_packet(orientation(k, rng)) + bytes(rng.choice([0, 0, 0, 1, 40])) for k in range(200)]
    packets[50:50] = [codec.encode_packet(packet) for packet in other_packets()]
    content = b"".join(map(encode_frame, packets))
    assert_same(decode_fast(content), decode_slowly(content))


def test_a_long_stream_with_damage_equals_the_slow_decoder(rng):
    frames = []
    for k in range(20_000):
        piece = bytearray(frame(orientation(k, rng)))
        chance = rng.random()
        if chance < 0.01:
            piece[rng.randrange(len(piece))] ^= 1 << rng.randrange(8)
        elif chance < 0.013:
            piece *= 2
        frames.append(bytes(piece))
        if rng.random() < 0.02:
            frames.append(frame(rng.choice(other_packets(boot_id=rng.choice([7, 7, 7, 8])))))
        if rng.random() < 0.002:
            frames.append(rng.choice(odd_frames()))
    content = b"".join(frames)
    slow = decode_slowly(content)
    for edges in ([], [rng.randrange(len(content)) for _ in range(40)], list(range(0, len(content), 997))):
        fast = decode_fast(content, edges)
        assert_same(fast, slow)
        assert_accounted(fast.counted)


def test_restart_after_the_link_was_cut(rng):
    decoder = StreamDecoder()
    decoder.feed(frame(orientation(5, rng)) + frame(orientation(6, rng))[:9])
    decoder.restart()
    decoder.feed(frame(orientation(400, rng))[4:] + frame(orientation(401, rng)))
    counters = decoder.counters
    assert counters.packets[PacketType.ORIENTATION] == 2
    assert (counters.crc_errors, counters.cobs_errors, counters.partial_starts) == (0, 0, 1)


def test_counters_are_a_snapshot_nobody_can_change(rng):
    decoder = StreamDecoder()
    before = decoder.counters
    decoder.feed(frame(orientation(1, rng)))
    assert before.bytes == 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        before.bytes = 1
    with pytest.raises(TypeError):
        before.packets[PacketType.ACK] = 1


def test_commands_travel_in_the_same_frames():
    assert encode_command(GetInfo(5)) == encode_frame(b"\x81\x05")
    assert StreamDecoder().feed(encode_command(GetInfo(5))) == [GetInfo(5)]
    assert StreamDecoder().feed(bytearray(encode_command(GetInfo(5)))) == [GetInfo(5)]
    assert StreamDecoder().feed(memoryview(encode_command(GetInfo(5)))) == [GetInfo(5)]
