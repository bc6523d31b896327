"""Framing at its bounds: the longest piece, pieces over two reads, cuts of the link, and every counter after each."""

import pytest

from firmware_protocol.errors import PacketValueError
from firmware_protocol.serial.framing import MAX_PACKET_BYTES, MAX_PIECE_BYTES, FrameDecoder, checksum, encode_frame

SHORT, OTHER = encode_frame(b"abc"), encode_frame(b"defgh")


def counted(decoder, *names):
    return tuple(getattr(decoder.counters, name) for name in names)


@pytest.mark.parametrize("n", [0, MAX_PACKET_BYTES + 1])
def test_a_packet_that_no_frame_can_carry_is_refused_with_its_length(n):
    with pytest.raises(PacketValueError) as raised:
        encode_frame(bytes(n))
    assert str(raised.value) == f"a packet must have 1 to {MAX_PACKET_BYTES} bytes, not {n}"


@pytest.mark.parametrize("n", [1, MAX_PACKET_BYTES])
def test_the_shortest_and_the_longest_packet_go_through_in_any_two_reads(n):
    packet = bytes(range(1, 256))[:n]
    frame = encode_frame(packet)
    for cut in range(len(frame) + 1):
        decoder = FrameDecoder()
        assert decoder.feed(frame[:cut]) + decoder.feed(frame[cut:]) == [packet]
        assert counted(decoder, "frames", "frame_bytes", "delimiters", "skipped_bytes") == (1, len(frame) - 2, 2, 0)


def test_the_longest_piece_waits_and_one_byte_more_does_not():
    longest = b"\1" * MAX_PIECE_BYTES
    decoder = FrameDecoder()
    decoder.feed(b"\0" + longest)
    assert counted(decoder, "pending_bytes", "oversize", "skipped_bytes") == (MAX_PIECE_BYTES, 0, 0)
    decoder.feed(b"\1")
    assert counted(decoder, "pending_bytes", "oversize", "skipped_bytes") == (0, 1, MAX_PIECE_BYTES + 1)
    decoder.feed(b"\1\1")
    assert counted(decoder, "pending_bytes", "oversize", "skipped_bytes") == (0, 1, MAX_PIECE_BYTES + 3)
    assert decoder.feed(b"\1\0" + SHORT) == [b"abc"]
    assert counted(decoder, "oversize", "skipped_bytes", "frames") == (1, MAX_PIECE_BYTES + 4, 1)


def test_a_second_piece_that_is_too_long_is_counted_as_well():
    decoder = FrameDecoder()
    for n in (1, 2, 3):
        decoder.feed(b"\0" + b"\1" * (MAX_PIECE_BYTES + n) + b"\0")
        assert decoder.counters.oversize == n
    assert decoder.counters.skipped_bytes == 3 * MAX_PIECE_BYTES + 6


@pytest.mark.parametrize("in_front", [b"", b"\0"])
def test_too_long_before_the_first_delimiter_is_the_rest_of_a_frame_and_no_error(in_front):
    decoder = FrameDecoder()
    decoder.feed(in_front + b"\1" * (MAX_PIECE_BYTES + 1))
    expected = (0, 1) if in_front else (1, 0)
    assert counted(decoder, "partial_starts", "oversize") == expected
    # Another read has the delimiter: what follows it is no start any more.
    decoder.feed(b"\0" + b"\1" * (MAX_PIECE_BYTES + 1))
    assert counted(decoder, "partial_starts", "oversize") == (expected[0], expected[1] + 1)


def test_the_start_of_the_stream_is_over_in_the_read_that_has_a_delimiter():
    """Also where the piece behind it is too long at once."""
    decoder = FrameDecoder()
    decoder.feed(b"\5\5\0" + b"\1" * (MAX_PIECE_BYTES + 1))
    assert counted(decoder, "partial_starts", "oversize") == (1, 1)


def test_a_cut_of_the_link_adds_what_was_pending_to_what_is_skipped():
    decoder = FrameDecoder()
    for n in (1, 2, 3):
        assert decoder.feed(SHORT + OTHER[:3]) == [b"abc"]
        decoder.restart()
        assert counted(decoder, "pending_bytes", "skipped_bytes") == (0, 2 * n)  # its delimiter is one already
    assert decoder.feed(OTHER[3:] + SHORT) == [b"abc"]
    assert counted(decoder, "partial_starts", "crc_errors", "cobs_errors") == (1, 0, 0)


def test_a_cut_ends_a_piece_that_is_too_long():
    decoder = FrameDecoder()
    decoder.feed(b"\0" + b"\1" * (MAX_PIECE_BYTES + 1))
    decoder.restart()
    assert decoder.feed(SHORT[1:]) == [b"abc"]  # it may start within a frame


def test_damaged_pieces_are_returned_by_their_length_but_starts_are_not():
    decoder = FrameDecoder()
    assert decoder.unframe(decoder.complete(b"\7\7\0")) == []
    assert decoder.unframe(decoder.complete(b"\7\7\0" + SHORT)) == [2, b"abc"]
    longest = b"\1" * MAX_PIECE_BYTES
    assert decoder.unframe(decoder.complete(longest + b"\0")) == [MAX_PIECE_BYTES]
    assert decoder.unframe(decoder.complete(longest + b"\1\0")) == []
    assert counted(decoder, "cobs_errors", "crc_errors", "oversize", "partial_starts") == (1, 1, 1, 1)


def test_every_cause_is_counted_each_time():
    decoder = FrameDecoder()
    good = SHORT[1:-1]
    wrong = bytes([*good[:-1], good[-1] ^ 1])
    for n in (1, 2, 3):
        decoder.feed(b"\0\xff\1\0" + b"\2\1\0" + wrong + b"\0")
        assert counted(decoder, "cobs_errors", "crc_errors") == (n, 2 * n)
        assert decoder.counters.skipped_bytes == n * (4 + len(wrong))


def test_the_place_of_the_next_piece_within_what_is_read():
    decoder = FrameDecoder()
    assert decoder.offset_of_next(SHORT) == 0
    decoder.feed(SHORT[:3])
    assert decoder.offset_of_next(SHORT[3:]) == -2
    decoder.feed(SHORT[3:] + b"\1" * (MAX_PIECE_BYTES + 1))
    assert decoder.offset_of_next(b"\1\1") == 0  # none yet
    assert decoder.offset_of_next(b"\1\1\1\0\1\0") == 3
    assert decoder.offset_of_next(b"\0" + SHORT) == 0


@pytest.mark.parametrize(("in_front", "behind"), [(0, 1), (1, 1), (3, 2), (1, 0)])
def test_a_lone_frame_is_counted_with_its_delimiters(in_front, behind):
    piece = SHORT[1:-1]
    decoder = FrameDecoder()
    assert decoder.at_start
    assert decoder.open_lone(b"\0" * in_front + piece + b"\0" * behind) == b"abc"
    assert counted(decoder, "frames", "frame_bytes", "delimiters") == (1, len(piece), in_front + behind)
    assert decoder.at_start is False
    assert decoder.open_lone(b"\0" + piece + b"\0") == b"abc"
    assert counted(decoder, "frames", "frame_bytes", "delimiters") == (2, 2 * len(piece), in_front + behind + 2)


def test_of_a_lone_frame_only_delimiters_are_taken_off():
    """A text editor's idea of an end, any letter, may be the last byte of a checksum."""
    ends = {encode_frame(bytes([a, b]))[-2] for a in range(1, 256) for b in range(1, 256)}
    assert len(ends) == 255  # all but the delimiter
    for a in range(1, 256):
        packet = bytes([a, 7])
        assert FrameDecoder().open_lone(encode_frame(packet)) == packet


@pytest.mark.parametrize("pieces", [b"", b"\0", SHORT + OTHER, b"\0\7\7\0", b"\0" + b"\1" * 300 + b"\0"])
def test_anything_but_a_lone_frame_is_left_alone(pieces):
    decoder = FrameDecoder()
    before = decoder.counters
    assert decoder.open_lone(pieces) is None
    assert decoder.counters == before
    assert decoder.at_start


def test_frames_that_were_decoded_elsewhere_are_added():
    decoder = FrameDecoder()
    for n in (1, 2):
        decoder.count(5, 2, 40)
        assert counted(decoder, "delimiters", "frames", "frame_bytes") == (5 * n, 2 * n, 40 * n)


def test_the_checksum_is_the_published_one():
    assert checksum(b"123456789") == 0x29B1
    assert checksum(b"") == 0xFFFF
