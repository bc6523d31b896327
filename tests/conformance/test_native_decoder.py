"""Three decoders that share no code: ours, one in C, and construct with the slow oracle; element by element."""

import random
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from cobs import cobs

from benchmarks import native, sample_streams
from benchmarks.native import NoCompilerError, native_crc, native_decode
from firmware_protocol import codec, schema
from firmware_protocol.packets import OrientationBatch, PacketType
from firmware_protocol.quantization import Q15_MAX_SQUARE, Q15_MIN_SQUARE
from firmware_protocol.serial.decoder import StreamDecoder
from firmware_protocol.serial.framing import encode_frame
from tests.wire_streams import decode_slowly, frame, odd_frames, orientation, other_packets

try:
    native_crc(b"")
except NoCompilerError:
    pytest.skip("the C decoder needs gcc", allow_module_level=True)

COMPARED = (
    "delimiters",
    "frames",
    "frame_bytes",
    "skipped_bytes",
    "pending_bytes",
    "cobs_errors",
    "crc_errors",
    "oversize",
    "partial_starts",
)


def decoded(data: bytes, cuts: list[int] = ()):
    decoder = StreamDecoder()
    edges = [0, *cuts, len(data)]
    batches = [
        item
        for start, end in pairwise(edges)
        for item in decoder.feed(data[start:end])
        if isinstance(item, OrientationBatch)
    ]
    columns = [
        np.concatenate([getattr(batch, name) for batch in batches]) if batches else np.empty(0)
        for name in ("sequence", "device_time_us", "quats_wxyz", "flags")
    ]
    return columns, decoder.counters


def assert_same_as_native(data: bytes, cuts: list[int] = ()) -> int:
    (sequence, time_us, quats, flags), counters = decoded(data, cuts)
    c_code = native_decode(data)
    assert {name: getattr(counters, name) for name in COMPARED} == {name: c_code.counters[name] for name in COMPARED}
    n = len(sequence)
    assert n == len(c_code.sequence) == counters.packets.get(PacketType.ORIENTATION, 0)
    if n:
        np.testing.assert_array_equal(sequence, c_code.sequence)
        np.testing.assert_array_equal(time_us, c_code.device_time_us)
        np.testing.assert_array_equal(flags, c_code.flags)
        np.testing.assert_array_equal(quats, c_code.quats_wxyz)
    for kind, count in counters.packets.items():
        if kind is not PacketType.ORIENTATION:
            assert count <= c_code.others[kind]
    return n


def test_crc_of_the_check_string():
    assert native_crc(b"123456789") == 0x29B1


def test_fast_generator_gives_what_the_encoder_gives():
    rng = random.Random(5)
    quats = sample_streams.turning(70_000)
    rows = sample_streams.frame_rows(quats)
    late = sample_streams.frame_rows(quats[:10], first=2**32 // 1000 - 5)
    first_late = 2**32 // 1000 - 5  # the device clock wraps among them
    chosen = [(k, k, rows[k]) for k in rng.sample(range(len(rows)), 300)]
    chosen += [(first_late + k, k, row) for k, row in enumerate(late)]
    for number, k, row in chosen:
        data = row.tobytes()
        packet = cobs.decode(data[1:-1])[:-2]
        assert encode_frame(packet) == data
        sample = codec.decode_packet(packet)
        assert (sample.sequence, sample.device_time_us) == (number % 65536, number * 1000 % 2**32)
        assert np.abs(np.array(sample.q_wxyz) - quats[k]).max() < 5e-5


def test_limits_of_the_norm_are_those_of_the_protocol():
    """The C code has them as numbers; frames on both sides of them."""
    for norm in (0.9899, 0.9901, 1.0099, 1.0101):
        q15 = round(32767 * norm / 2)
        packet = b"\x02" + bytes(6) + q15.to_bytes(2, "little", signed=True) * 4 + b"\0"
        assert assert_same_as_native(encode_frame(packet)) == (0.99 < norm < 1.01)
    text = (Path(native.__file__).parent / "native_decoder.c").read_text()
    assert f"MIN_SQUARE {Q15_MIN_SQUARE}.0" in text
    assert f"MAX_SQUARE {Q15_MAX_SQUARE}.0" in text


def test_clean_stream():
    stream = sample_streams.clean_stream(200_000)
    assert assert_same_as_native(stream.data) == stream.n_samples
    assert assert_same_as_native(stream.data, cuts=[7, 21 * 1000 + 3, 2_000_000]) == stream.n_samples


@pytest.mark.parametrize("seed", range(4))
def test_damaged_stream_with_other_packets(seed):
    stream = sample_streams.mixed_stream(50_000, damaged_share=0.01 + 0.1 * seed, other_share=0.02, seed=seed)
    n = assert_same_as_native(stream.data)
    assert abs(n - stream.n_samples) <= 3  # one in 65536 damaged frames has the right checksum
    assert_same_as_native(stream.data, cuts=sorted(random.Random(seed).sample(range(len(stream.data)), 40)))


@pytest.mark.parametrize("seed", range(20))
def test_cut_spliced_and_noisy(seed):
    rng = random.Random(seed)
    parts = [frame(orientation(k, rng)) for k in range(600)]
    for _ in range(60):
        kind = rng.randrange(5)
        at = rng.randrange(len(parts))
        if kind == 0:
            parts.insert(at, frame(rng.choice(other_packets())))
        elif kind == 1:
            parts.insert(at, rng.choice(odd_frames()))
        elif kind == 2:
            parts[at] = parts[at][rng.randrange(10) :]
        elif kind == 3:
            parts.insert(at, bytes(rng.randrange(1, 256) for _ in range(rng.choice([3, 40, 255, 256, 700]))))
        else:
            parts.insert(at, rng.randbytes(30))
    data = b"".join(parts)[rng.randrange(30) :]
    n = assert_same_as_native(data)
    slow = decode_slowly(data)
    assert n == sum(isinstance(item, tuple) for item in slow.items)
    c_code = native_decode(data)
    assert [slow.counted[name] for name in COMPARED] == [c_code.counters[name] for name in COMPARED]


@pytest.mark.parametrize("stream", [sample_streams.clean_stream(5000), sample_streams.mixed_stream(5000)])
def test_compiled_construct_gives_the_same_fields(stream):
    """construct's compiled parser on every packet whose frame the C decoder accepted."""
    parser = schema.SCHEMA[PacketType.ORIENTATION].compile()
    c_code = native_decode(stream.data)
    rows = []
    for piece in stream.data.split(b"\0"):
        try:
            content = cobs.decode(piece)
        except cobs.DecodeError:
            continue
        if (
            len(content) == 18
            and content[0] == PacketType.ORIENTATION
            and native_crc(content[:-2]) == int.from_bytes(content[-2:], "little")
        ):
            rows.append(parser.parse(content))
    (sequence, time_us, quats, flags), _ = decoded(stream.data)
    assert len(rows) == len(sequence) == len(c_code.sequence)
    for k, row in enumerate(rows):
        assert (row.sequence, row.device_time_us, row.flags) == (sequence[k], time_us[k], flags[k])
        q = np.array(row.q_wxyz)
        assert np.abs(q / np.linalg.norm(q) - quats[k]).max() < 4e-16
