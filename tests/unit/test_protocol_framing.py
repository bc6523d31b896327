"""Frames in a byte stream: what is found, what is skipped, and that every byte is accounted for."""

import pytest
from cobs import cobs

from firmware_protocol.errors import PacketValueError
from firmware_protocol.serial.framing import (
    MAX_PACKET_BYTES,
    MAX_PIECE_BYTES,
    FrameDecoder,
    checksum,
    encode_frame,
)


def fed(*chunks):
    decoder = FrameDecoder()
    packets = [packet for chunk in chunks for packet in decoder.feed(chunk)]
    counters = decoder.counters
    accounted = counters.delimiters + counters.frame_bytes + counters.skipped_bytes + counters.pending_bytes
    assert counters.bytes == accounted == sum(map(len, chunks))
    return packets, counters


def test_the_checksum_has_the_catalogued_check_value():
    assert checksum(b"123456789") == 0x29B1


def test_a_frame_is_as_laid_down():
    assert encode_frame(b"123456789").hex() == "000c" + b"123456789".hex() + "b12900"


@pytest.mark.parametrize("packet", [b"a", bytes(MAX_PACKET_BYTES), b"\xff" * MAX_PACKET_BYTES, bytes(range(252))])
def test_packets_of_every_size_come_back(packet):
    frame = encode_frame(packet)
    assert len(frame) == len(packet) + 5, "COBS adds exactly one byte"
    assert 0 not in frame[1:-1]
    assert fed(frame)[0] == [packet]


@pytest.mark.parametrize("packet", [b"", bytes(MAX_PACKET_BYTES + 1)])
def test_packets_without_a_frame_are_refused(packet):
    with pytest.raises(PacketValueError):
        encode_frame(packet)


def test_a_delimiter_may_be_shared_by_two_frames():
    a, b = encode_frame(b"one"), encode_frame(b"two")
    packets, counters = fed(a + b[1:] + b[1:])
    assert packets == [b"one", b"two", b"two"]
    assert (counters.frames, counters.delimiters) == (3, 4)


def test_a_link_opened_inside_a_frame_is_no_error():
    packets, counters = fed(encode_frame(b"lost")[3:], encode_frame(b"kept"))
    assert packets == [b"kept"]
    assert counters.partial_starts == 1
    assert counters.cobs_errors == counters.crc_errors == counters.oversize == 0


def test_a_first_frame_without_its_delimiter_is_a_frame():
    packets, counters = fed(encode_frame(b"kept")[1:])
    assert packets == [b"kept"]
    assert counters.partial_starts == 0


def damaged(frame):
    body = bytearray(frame)
    body[3] ^= 0x10
    return bytes(body)


@pytest.mark.parametrize(
    ("piece", "counter"),
    [
        (damaged(encode_frame(b"packet"))[1:-1], "crc_errors"),
        (b"\x02a", "crc_errors"),  # one byte only: no room for a checksum
        (b"\x01", "crc_errors"),
        (b"\x09abc", "cobs_errors"),
        (b"x" * (MAX_PIECE_BYTES + 1), "oversize"),
        (b"x" * 5000, "oversize"),
    ],
)
@pytest.mark.parametrize("step", [1, 7, 100_000])
def test_damage_counts_once_by_cause(piece, counter, step):
    data = encode_frame(b"before") + piece + encode_frame(b"after")
    packets, counters = fed(*(data[at : at + step] for at in range(0, len(data), step)))
    assert packets == [b"before", b"after"]
    assert counters.skipped_bytes == len(piece)
    names = ("crc_errors", "cobs_errors", "oversize", "partial_starts")
    assert {name: getattr(counters, name) for name in names if getattr(counters, name)} == {counter: 1}


def test_the_buffer_is_capped_and_one_endless_piece_counts_once():
    decoder = FrameDecoder()
    decoder.feed(b"\0")
    for _ in range(1000):
        decoder.feed(b"x" * 100)
        assert decoder.counters.pending_bytes <= MAX_PIECE_BYTES
    assert decoder.counters.oversize == 1
    assert decoder.feed(encode_frame(b"after")) == [b"after"]
    assert decoder.counters.skipped_bytes == 100_000


def test_an_empty_packet_is_a_frame_of_nothing():
    packets, counters = fed(b"\0" + cobs.encode(b"\xff\xff") + b"\0")
    assert packets == [b""]
    assert counters.frames == 1


def test_restart_forgets_the_piece_begun():
    decoder = FrameDecoder()
    frame = encode_frame(b"cut off")
    decoder.feed(frame[:5])
    decoder.restart()
    assert decoder.feed(frame[5:] + encode_frame(b"after")) == [b"after"]
    counters = decoder.counters
    assert (counters.skipped_bytes, counters.partial_starts, counters.crc_errors) == (len(frame) - 2, 1, 0)
    assert counters.bytes == counters.delimiters + counters.frame_bytes + counters.skipped_bytes
