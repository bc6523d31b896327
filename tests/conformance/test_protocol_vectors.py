"""The shipped golden vectors: they are what the code makes, and every decoder reads them as they say."""

import dataclasses
import math

import numpy as np
import pytest

from docs.field_tables import field_rows
from firmware_protocol import codec, quantization
from firmware_protocol.packets import OrientationBatch, PacketType
from firmware_protocol.serial import decoder as stream
from firmware_protocol.serial.decoder import StreamDecoder
from firmware_protocol.serial.framing import FrameDecoder, checksum, encode_frame
from tests.vectors.files import SERIAL_FILE, load_vectors
from tests.vectors.serial_definitions import PACKETS, fields_of, vectors_text
from tests.wire_streams import Decoded, assert_accounted, decode_fast, decode_slowly, slow_crc, slow_uncobs

VECTORS = load_vectors()


def unit(quat):
    """A quaternion as it should be: those of some vectors have a norm that filters leave."""
    return [component / math.hypot(*quat) for component in quat]


def named(section):
    return pytest.mark.parametrize("vector", VECTORS[section], ids=lambda vector: vector["name"].replace(" ", "-"))


def test_the_shipped_file_is_what_the_code_makes():
    shipped = SERIAL_FILE.read_text(encoding="utf-8")
    assert shipped == vectors_text(), "run `python -m tests.vectors` and read the difference"


def test_every_packet_type_and_every_counter_has_a_vector():
    assert {vector["packet_type"] for vector in VECTORS["packets"]} == {packet_type.name for packet_type in PacketType}
    counted = {name for vector in VECTORS["streams"] for name in vector["counters"]}
    of_the_sequence = {"sequence_gaps", "samples_lost", "duplicates", "reordered"}
    # `packets` is checked by sequence numbers.
    not_here = {"bytes", "delimiters", "packets"}
    assert counted | not_here == set(vars(StreamDecoder().counters)) | of_the_sequence


def test_names_are_unique():
    for section in ("packets", "streams"):
        names = [vector["name"] for vector in VECTORS[section]]
        assert len(set(names)) == len(names)


@pytest.mark.parametrize("vector", VECTORS["crc16"], ids=lambda vector: vector["bytes"][:20] or "empty")
def test_checksums(vector):
    data = bytes.fromhex(vector["bytes"])
    assert checksum(data) == slow_crc(data) == int(vector["crc"], 16)


@pytest.mark.parametrize("vector", VECTORS["cobs"], ids=lambda vector: vector["bytes"][:20] or "empty")
def test_cobs(vector):
    encoded = bytes.fromhex(vector["cobs"])
    assert slow_uncobs(encoded) == bytes.fromhex(vector["bytes"])
    assert 0 not in encoded


@pytest.mark.parametrize("vector", VECTORS["quaternions"], ids=lambda vector: vector["smallest_three"])
def test_quaternions(vector):
    quat = vector["q_wxyz"]
    assert list(quantization.quat_to_q15(quat)) == vector["q15"]
    assert quantization.quats_to_smallest_three([quat])[0] == int(vector["smallest_three"], 16)
    decoded, valid = quantization.quats_from_smallest_three(np.array([int(vector["smallest_three"], 16)], np.uint64))
    assert valid.all()
    assert abs(decoded[0] @ unit(quat)) == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize(("name", "packet"), PACKETS, ids=[name.replace(" ", "-") for name, _ in PACKETS])
def test_packets_encode_to_their_bytes(name, packet):
    vector = next(vector for vector in VECTORS["packets"] if vector["name"] == name)
    assert codec.encode_packet(packet).hex() == vector["packet"]
    assert encode_frame(codec.encode_packet(packet)).hex() == vector["frame"]


@named("packets")
def test_packets_decode_to_their_meaning(vector):
    packet = codec.decode_packet(bytes.fromhex(vector["packet"]))
    assert packet.packet_type.name == vector["packet_type"]
    got = fields_of(packet)
    if "q_wxyz" in got:
        assert got.pop("q_wxyz") == pytest.approx(unit(vector["fields"]["q_wxyz"]), abs=1 / quantization.Q15_SCALE)
    if "gyro_dps" in got:  # full scale itself is one step above the largest code
        assert got.pop("gyro_dps") == pytest.approx(vector["fields"]["gyro_dps"], abs=2000 / 32768)
    assert got == {name: vector["fields"][name] for name in got}
    assert FrameDecoder().feed(bytes.fromhex(vector["frame"])) == [bytes.fromhex(vector["packet"])]


def test_a_norm_above_one_wraps_where_it_is_rounded_as_it_is():
    """So that firmware which does not normalise fails on these vectors, not on the bench."""
    hit = 0
    for vector in VECTORS["quaternions"]:
        wrapped = [
            (round(component * quantization.Q15_SCALE) + 0x8000) % 0x10000 - 0x8000 for component in vector["q_wxyz"]
        ]
        hit += wrapped != vector["q15"]
    assert hit >= 3


@named("packets")
def test_frames_decode_through_the_stream(vector):
    decoder = StreamDecoder()
    (item,) = decoder.feed(bytes.fromhex(vector["frame"]))
    assert decoder.counters.packets == {PacketType[vector["packet_type"]]: 1}
    if isinstance(item, OrientationBatch):
        assert item.sequence.tolist() == [vector["fields"]["sequence"]]
        assert item.device_time_us.tolist() == [vector["fields"]["device_time_us"]]
        assert item.flags.tolist() == [vector["fields"]["flags"]]
    else:
        assert repr(item) == repr(codec.decode_packet(bytes.fromhex(vector["packet"])))


@named("packets")
def test_null_stands_for_nan_only_where_the_field_table_allows_it(vector):
    nullable = {"size_mm", "mass_g", "com_mm", "temperature_c"}
    for name, value in vector["fields"].items():
        parts = value if isinstance(value, list) else [value]
        assert all(part is not None for part in parts) or name in nullable
        assert not any(isinstance(part, float) and not math.isfinite(part) for part in parts)


def check_stream(vector, decoded: Decoded):
    counted = decoded.plain()
    data = bytes.fromhex(vector["bytes"])
    assert counted.pop("bytes") == len(data)
    assert counted.pop("delimiters") == data.count(0)
    assert {name: n for name, n in counted.items() if not name.startswith("packets ")} == vector["counters"]
    assert [item[1] for item in decoded.items if isinstance(item, tuple)] == vector["sequences"]
    assert_accounted(decoded.counted)


@named("streams")
def test_streams_one_by_one_and_together_and_byte_by_byte(vector, monkeypatch):
    data = bytes.fromhex(vector["bytes"])
    check_stream(vector, decode_fast(data))
    check_stream(vector, decode_fast(data, list(range(len(data)))))
    monkeypatch.setattr(stream, "BATCH_BYTES", 1)
    check_stream(vector, decode_fast(data))


@named("streams")
def test_streams_through_the_slow_decoder(vector):
    check_stream(vector, decode_slowly(bytes.fromhex(vector["bytes"])))


def test_all_streams_in_a_row():
    """Bad vectors do not spoil what follows them."""
    everything = b"".join(bytes.fromhex(vector["bytes"]) + b"\0" for vector in VECTORS["streams"])
    sequences = [sequence for vector in VECTORS["streams"] for sequence in vector["sequences"]]
    decoded = decode_fast(everything)
    assert [item[1] for item in decoded.items if isinstance(item, tuple)] == sequences


def test_fields_carry_the_names_of_the_field_tables():
    for _, packet in PACKETS:
        rows = field_rows(packet.packet_type)
        assert {row.name for row in rows} == {"packet_type", *fields_of(packet)}
        assert dataclasses.is_dataclass(packet)
