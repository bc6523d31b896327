"""The C library's packets and frames against the golden vectors, the schema in construct, and the Python codec."""

import math
import random
import re
import struct
import subprocess

import numpy as np
import pytest

from analysis.geometry.rotations import distance
from docs.field_tables import field_rows
from emulator.motion.hand_motion import HandMotion
from emulator.scenario import load_scenario
from firmware_protocol import codec, schema
from firmware_protocol.errors import MalformedPacketError, UnknownPacketTypeError, UnsupportedVersionError
from firmware_protocol.packets import OrientationBatch, PacketType, SetRate
from firmware_protocol.quantization import Q15_MAX_ERROR_RAD, Q15_MAX_SQUARE, Q15_MIN_SQUARE, quat_to_q15
from firmware_protocol.serial.decoder import StreamDecoder, encode_command
from firmware_protocol.serial.framing import encode_frame
from tests.c_library.build import LIBRARY, SANITIZERS, SOURCES, WARNINGS, MissingToolError, tool
from tests.c_library.damaged_streams import Streams, compare, decoded_by_c
from tests.vectors.files import load_vectors
from tests.wire_streams import decode_slowly

VECTORS = load_vectors()
PACKET, MALFORMED, UNKNOWN_TYPE, UNSUPPORTED_VERSION = 1, 2, 3, 4
FUSION_NORM = 1.000122  # what x-io Fusion's fast inverse square root leaves


def numbers(values):
    """Flat wire values as the C program writes them: texts byte by byte, floats by their bits."""
    found = []
    for value in values:
        if isinstance(value, bytes):
            found += list(value)
        elif isinstance(value, float):
            found.append(struct.unpack("<I", struct.pack("<f", value))[0])
        else:
            found.append(value)
    return found


def judged(data):
    """Return the Python codec's verdict on a packet, as the C library's rd_result."""
    try:
        codec.decode_packet(data)
    except MalformedPacketError:
        return MALFORMED
    except UnknownPacketTypeError:
        return UNKNOWN_TYPE
    except UnsupportedVersionError:
        return UNSUPPORTED_VERSION
    return PACKET


def assert_decodes_as_ours(driver, packets):
    """Every packet is judged the same; where it is good, its fields are construct's and it encodes to itself again."""
    good = 0
    for data, answer in zip(packets, driver.ask(f"decode {data.hex()}" for data in packets), strict=True):
        result, *rest = answer.split()
        assert int(result) == judged(data), data.hex()
        if int(result) == PACKET:
            good += 1
            known = data[: schema.PACKET_BYTES[PacketType(data[0])]]
            assert rest[0] == known.hex()
            assert bits_of(data[0], rest[1:]) == known[1:]
            if not has_nan(data):  # bits_of has compared those: one NaN is many bit patterns
                assert list(map(int, rest[1:])) == numbers(schema.parse(data))
    return good


def has_nan(data):
    return any(isinstance(value, float) and math.isnan(value) for value in schema.parse(data))


def bits_of(type_byte, fields):
    """Fields of the C program put together again by the schema's own table."""
    layout = "<"
    for row in field_rows(PacketType(type_byte))[1:]:
        kind, _, count = row.wire_type.partition("[")
        count = int(count.rstrip("]")) if count else 1
        if kind.startswith("{"):
            layout += "BH" * count
        elif kind == "char":
            layout += "B" * count
        else:
            layout += {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i16": "h", "f32": "I"}[kind] * count
    return struct.pack(layout, *map(int, fields))


# ---- golden vectors, on this machine under the sanitizers and on the emulated boards


def test_checksums(any_driver):
    vectors = VECTORS["crc16"]
    assert any_driver.ask(f"crc {vector['bytes']}" for vector in vectors) == [vector["crc"] for vector in vectors]


def test_every_packet_gets_its_frame_and_decodes_to_itself(any_driver):
    vectors = VECTORS["packets"]
    frames = any_driver.ask(f"frame {vector['packet']}" for vector in vectors)
    assert frames == [vector["frame"] for vector in vectors]
    assert assert_decodes_as_ours(any_driver, [bytes.fromhex(vector["packet"]) for vector in vectors]) == len(vectors)


def test_packets_are_built_from_their_fields(any_driver):
    packets = [bytes.fromhex(vector["packet"]) for vector in VECTORS["packets"]]
    lines = [f"build {data[0]} {' '.join(map(str, numbers(schema.parse(data))))}" for data in packets]
    assert any_driver.ask(lines) == [data.hex() for data in packets]


def test_quaternions_are_those_of_the_vectors(any_driver):
    """Norms of 1.0001 among them: no component may wrap."""
    vectors = VECTORS["quaternions"]
    assert any(abs(math.hypot(*vector["q_wxyz"]) - 1) > 9e-5 for vector in vectors)
    lines = [f"quantise {' '.join(map(repr, vector['q_wxyz']))}" for vector in vectors]
    answers = [list(map(int, answer.split())) for answer in any_driver.ask(lines)]
    assert answers == [[1, *vector["q15"]] for vector in vectors]


def test_streams_give_their_samples_and_counters(any_driver):
    vectors = VECTORS["streams"]
    answers = any_driver.ask(f"stream {vector['bytes']}" for vector in vectors)
    for vector, answer in zip(vectors, answers, strict=True):
        decoded = decoded_by_c(answer)
        counted = {name: n for name, n in decoded.plain().items() if not name.startswith("packets ")}
        data = bytes.fromhex(vector["bytes"])
        assert counted.pop("bytes") == len(data)
        assert counted.pop("delimiters") == data.count(0)
        assert counted == vector["counters"], vector["name"]
        assert [item[1] for item in decoded.items if isinstance(item, tuple)] == vector["sequences"]


# ---- random packets: construct -> C -> construct, and back


def random_values(packet_type, rng):
    """Flat wire values: mostly inside their ranges, often at an end of them, sometimes anything."""
    sensible = {
        "protocol_major": lambda: rng.choice((1, 1, 1, 1, 0, 2, 255)),
        "rate_hz": lambda: rng.choice((10, 100, 1000, 10, 100, 1000, 9, 1001, 0)),
        "shape": lambda: rng.choice((0, 1, 2, 3, 255, 255, 4)),
        "weight_count": lambda: rng.choice((0, 1, 8, 8, 9)),
        "state": lambda: rng.choice((0, 1, 2, 3, 4)),
        "code": lambda: rng.randrange(8),
        "kind": lambda: rng.randrange(3),
        "with_raw_imu": lambda: rng.randrange(3),
    }
    values = []
    for row in field_rows(packet_type)[1:]:
        kind, _, count = row.wire_type.partition("[")
        count = int(count.rstrip("]")) if count else 1
        if row.name == "q_wxyz":
            q = np.array([rng.gauss(0, 1) for _ in range(4)])
            scale = rng.choice((1, 1, 0.995, 0.98, 1.02)) * 32767
            values += np.clip(np.rint(q / np.linalg.norm(q) * scale), -32768, 32767).astype(int).tolist()
        elif row.name == "mounting_q_body_sensor":
            q = np.array([rng.gauss(0, 1) for _ in range(4)])
            scale = rng.choice((1, 1, 1, 1.0099, 0.9901, 1.0101, 0.9899, math.nan))
            values += np.float32(q / np.linalg.norm(q) * scale).tolist()
        elif kind == "char":
            values.append(rng.randbytes(count))
        elif kind.startswith("{"):
            for _ in range(count):
                values += (rng.randrange(256), rng.randrange(65536))
        elif kind == "f32":
            values += [
                float(np.float32(rng.choice((0.0, -0.0, 1.5, 3e38, 1e-40, math.nan, *FLOATS)))) for _ in range(count)
            ]
        elif row.name in sensible:
            values.append(sensible[row.name]())
        else:
            bits = 8 * int(row.size) // count
            low = -(1 << bits - 1) if kind[0] == "i" else 0
            high = low + (1 << bits) - 1
            values += [rng.choice((low, high, 0, rng.randint(low, high), rng.randint(low, high))) for _ in range(count)]
    return values


FLOATS = [1.0] * 12 + [-1.0, math.inf, -math.inf]  # mostly good: an INFO has seven of them


@pytest.mark.parametrize("packet_type", PacketType, ids=lambda packet_type: packet_type.name)
def test_random_packets_go_from_construct_to_c_and_back(c_driver, packet_type):
    rng = random.Random(int(packet_type))
    packets = [schema.build(packet_type, random_values(packet_type, rng)) for _ in range(400)]
    tails = [data + rng.randbytes(rng.randrange(1, 20)) for data in packets[:40]]
    good = assert_decodes_as_ours(c_driver, packets + tails)
    assert good > 20
    has_bad_values = {"INFO", "ORIENTATION", "STATUS", "ACK", "EVENT", "START"}
    assert (good < len(packets) + len(tails)) == (packet_type.name in has_bad_values)


@pytest.mark.parametrize("packet_type", PacketType, ids=lambda packet_type: packet_type.name)
def test_random_fields_are_encoded_as_construct_does(c_driver, packet_type):
    """And refused where the host would refuse the packet."""
    rng = random.Random(100 + int(packet_type))
    built = [random_values(packet_type, rng) for _ in range(300)]
    answers = c_driver.ask(f"build {int(packet_type)} {' '.join(map(str, numbers(values)))}" for values in built)
    for values, answer in zip(built, answers, strict=True):
        data = schema.build(packet_type, values)
        if judged(data) != UNSUPPORTED_VERSION:  # an object may be of another version: the host refuses it, not itself
            assert answer == (data.hex() if judged(data) == PACKET else "-")


def test_tables_agree_on_every_value_of_a_byte(c_driver):
    """Each byte of each packet of the vectors, set to every value."""
    packets = {vector["packet_type"]: bytes.fromhex(vector["packet"]) for vector in VECTORS["packets"]}
    packets["INFO"] = next(bytes.fromhex(vector["packet"]) for vector in VECTORS["packets"])  # the one with all numbers
    changed = []
    for name, data in packets.items():
        enumerated = ("packet_type", "protocol_major", "shape", "weight_count", "state", "code", "kind", "with_raw_imu")
        for row in field_rows(PacketType[name]):
            if row.name in enumerated:
                changed += [data[: row.offset] + bytes([value]) + data[row.offset + 1 :] for value in range(256)]
    assert assert_decodes_as_ours(c_driver, changed) > 100


def test_packets_cut_anywhere(c_driver):
    cut = {data[:n] for v in VECTORS["packets"] for data in [bytes.fromhex(v["packet"])] for n in range(len(data) + 1)}
    cut |= {b"\x01\x02" + data[2:] for data in cut if data[:1] == b"\x01"}
    assert_decodes_as_ours(c_driver, sorted(cut))


def test_the_limits_of_the_norm_are_exact(c_driver):
    """Four int16 whose squares sum to just inside and just outside both limits."""
    packets = []
    for limit, sign in ((Q15_MIN_SQUARE, -1), (Q15_MAX_SQUARE, 1)):
        for square in (limit, limit + sign):
            packets.append(b"\x02" + bytes(6) + struct.pack("<4h", *four_squares(square)) + b"\0")
    packets.append(b"\x02" + bytes(6) + struct.pack("<4h", *[-32768] * 4) + b"\0")  # the sum wraps 32 bits
    assert [judged(data) for data in packets] == [PACKET, MALFORMED, PACKET, MALFORMED, MALFORMED]
    assert assert_decodes_as_ours(c_driver, packets) == 2


def four_squares(square):
    """Four integers below 32768 whose squares have this sum (Lagrange), by search."""
    for a in range(32767, 0, -1):
        rest = square - a * a
        if rest < 0:
            continue
        for b in range(math.isqrt(rest), -1, -1):
            left = rest - b * b
            for c in range(math.isqrt(left), max(math.isqrt(left) - 40, -1), -1):
                d = math.isqrt(left - c * c)
                if d * d == left - c * c:
                    return a, b, c, d
    raise AssertionError


# ---- values


def quantised(driver, quats):
    answers = driver.ask(f"quantise {' '.join(map(repr, q))}" for q in np.asarray(quats).tolist())
    rows = np.array([list(map(int, answer.split())) for answer in answers])
    return rows[:, 0].astype(bool), rows[:, 1:]


def test_quaternions_are_quantised_as_ours_are(c_driver):
    """Of any norm the wire allows: within a rounding of the exact number, and the rotation within the bound."""
    rng = np.random.default_rng(3)
    units = rng.normal(size=(4000, 4))
    units /= np.linalg.norm(units, axis=1)[:, None]
    units[:200] = np.eye(4)[rng.integers(0, 4, 200)] * rng.choice((-1, 1), (200, 1)) + 1e-3 * units[:200]
    units /= np.linalg.norm(units, axis=1)[:, None]
    quats = units * rng.uniform(0.9901, 1.0099, (4000, 1))
    good, codes = quantised(c_driver, quats)
    assert good.all()
    ours = np.array([quat_to_q15(q) for q in quats.tolist()])
    assert np.abs(codes - units * 32767).max() < 0.51
    assert (codes != ours).mean() < 0.02
    decoded = codes / np.linalg.norm(codes, axis=1)[:, None]
    assert distance(decoded, units).max() <= Q15_MAX_ERROR_RAD


def test_no_orientation_is_sent_where_the_filter_failed(c_driver):
    bad = [
        [0, 0, 0, 0],
        [math.nan, 0, 0, 1],
        [math.inf, 0, 0, 0],
        [1e30, 0, 0, 0],
        [0.9899, 0, 0, 0],
        [0, 1.0101, 0, 0],
    ]
    good, codes = quantised(c_driver, bad)
    assert not good.any()
    assert not codes.any()


def test_measured_values_stop_at_the_ends_of_the_scale(c_driver):
    values = [("0.4", 0), ("0.6", 1), ("-0.6", -1), ("1e9", 32767), ("-1e9", -32768), ("nan", 0), ("32766.6", 32767)]
    values += [("32767.6", 32767), ("35000", 32767), ("-32768.6", -32768), ("-35000", -32768), ("-32767.4", -32767)]
    assert c_driver.ask(f"counts {value} -32768" for value, _ in values) == [str(expected) for _, expected in values]
    assert c_driver.ask(["counts -40000 -32767", "counts -inf -32767"]) == ["-32767", "-32767"]


def test_a_filter_that_leaves_norms_above_one_sends_the_right_rotation(any_driver):
    """The emulator's default trial through a filter like x-io Fusion's default build, down to the host's decoder.

    It starts at the identity, where w times 32767 is beyond int16 for such a norm: rounded as it is, as the last lines
    do, it wraps, and the host receives another rotation with a right checksum and a right norm.
    """
    scenario = load_scenario("default")
    motion = HandMotion(scenario.motion, scenario.drift, scenario.seed)
    truth = motion.orientation(np.arange(0.0, 6.0, 0.05))
    quats = truth * FUSION_NORM
    lines = [f"quantise {' '.join(map(repr, q))}" for q in quats.tolist()]
    codes = [list(map(int, answer.split()))[1:] for answer in any_driver.ask(lines)]
    built = any_driver.ask(f"build 2 {k} {k * 50_000} {' '.join(map(str, code))} 0" for k, code in enumerate(codes))
    frames = any_driver.ask(f"frame {packet}" for packet in built)
    (batch,) = StreamDecoder().feed(bytes.fromhex("".join(frames)))
    assert isinstance(batch, OrientationBatch)
    assert len(batch) == len(truth)
    assert distance(batch.quats_wxyz, truth).max() <= Q15_MAX_ERROR_RAD
    wrapped = np.rint(quats * 32767).astype(np.int64).astype(np.int16).astype(float)
    wrapped /= np.linalg.norm(wrapped, axis=1)[:, None]
    assert distance(wrapped, truth).max() > 100 * Q15_MAX_ERROR_RAD


# ---- damaged streams


def test_damaged_streams_give_what_the_decoder_gives(c_driver):
    source = Streams(seed=20)
    met = compare(c_driver, [source.next() for _ in range(1500)])
    assert min(source.kinds.values()) > 50
    for name in ("cobs_errors", "crc_errors", "oversize", "partial_starts", "malformed", "unknown_types", "extended"):
        assert met[name] > 5, name
    for name in ("duplicates", "reordered", "sequence_gaps", "sequence_restarts", "unsupported_versions"):
        assert met[name] > 5, name


def test_damaged_streams_on_the_boards(any_driver):
    source = Streams(seed=21)
    assert compare(any_driver, [source.next() for _ in range(60)])["frames"] > 200


def test_the_same_streams_through_the_slow_decoder(c_driver):
    """A third opinion, which shares nothing with the two."""
    source = Streams(seed=22)
    streams = [source.next() for _ in range(100)]
    for stream, answer in zip(streams, c_driver.ask(f"stream {stream.hex()}" for stream in streams), strict=True):
        slow, ours = decode_slowly(stream), decoded_by_c(answer)
        assert ours.plain() == slow.plain()
        assert len(ours.items) == len(slow.items)


def test_long_losses_and_late_samples(c_driver):
    """The memory of lost numbers reaches back as far as the decoder's, over the wrap, and no further."""
    from tests.wire_streams import frame, orientation

    rng = random.Random(5)
    for first in (0, 65300, 30000):
        sequences = [
            first,
            first + 300,
            *range(first + 300, first + 20, -7),
            first + 900,
            first + 645,
            first + 644,
            first + 643,
        ]
        sequences += [
            first + 2000,
            first + 2000 - 255,
            first + 2000 - 512,
            first + 2001,
            first + 40_000,
            first + 40_001 - 512,
        ]
        compare(c_driver, [b"".join(frame(orientation(number, rng)) for number in sequences)])


# ---- the example of the library's page

HARNESS = """
#include <stdio.h>

void link_write(const uint8_t *bytes, size_t n)
{
    while (n--) printf("%02x", *bytes++);
    printf("\\n");
}

void answer(const rd_packet *command, rd_result result, const uint8_t *bytes, size_t n)
{
    printf("%d %d %d %d\\n", (int)result, command->type, bytes[1], (int)n);
}

int main(void)
{
    const float q[4] = {1.000122f, 0.0f, 0.0f, 0.0f}, failed[4] = {0};
    printf("%d\\n", send_sample(7, 70000, q, RD_FLAG_STILL));
    printf("%d\\n", send_sample(8, 80000, failed, 0));
    for (int byte; (byte = getchar()) != EOF;) byte_received((uint8_t)byte);
    return 0;
}
"""


def test_the_example_of_the_page_sends_a_sample_and_receives_commands(tmp_path):
    try:
        compiler = tool("gcc", "gcc")
    except MissingToolError as error:
        pytest.skip(str(error))
    (code,) = re.findall(r"```c\n(.*?)```", (LIBRARY / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "object.c").write_text(code + HARNESS, encoding="utf-8")
    flags = [flag for flag in WARNINGS if flag != "-Wstrict-prototypes"]
    files = ["object.c", *SOURCES, "-o", "object"]
    subprocess.run([compiler, *flags, *SANITIZERS, "-I", LIBRARY, *files], cwd=tmp_path, check=True, timeout=60)
    commands = (
        encode_command(SetRate(9, 100)) + encode_frame(b"\xee\x0a") + encode_frame(b"\x84\x0b") + encode_frame(b"\x84")
    )
    done = subprocess.run([tmp_path / "object"], input=commands, capture_output=True, check=True, timeout=60)
    sample, sent, failed, *answers = done.stdout.decode().splitlines()
    (batch,) = StreamDecoder().feed(bytes.fromhex(sample))
    assert (batch.sequence.tolist(), batch.device_time_us.tolist(), batch.flags.tolist()) == ([7], [70000], [1])
    assert batch.quats_wxyz.tolist() == [[1.0, 0.0, 0.0, 0.0]]
    assert (sent, failed) == ("1", "0")
    assert answers == [f"{PACKET} 132 9 4", f"{UNKNOWN_TYPE} 238 10 2", f"{MALFORMED} 132 11 2"]
