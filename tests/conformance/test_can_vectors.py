"""Golden vectors of the CAN mapping: the bytes, and by hand, field by field, what some of them mean."""

import json
import struct

import pytest

from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.frames import CanFrame, FrameFlag, pack_frames
from firmware_protocol.codec import decode_packet
from firmware_protocol.packets import Orientation, OrientationBatch
from tests.vectors.can_definitions import can_vectors_text
from tests.vectors.files import CAN_FILE

TEXT = CAN_FILE.read_text(encoding="utf-8")
VECTORS = json.loads(TEXT)["vectors"]


def frames_of(vector: dict) -> list[CanFrame]:
    return [
        CanFrame(
            int(frame["id"], 16),
            bytes.fromhex(frame["data"]),
            FrameFlag.FD | FrameFlag.BITRATE_SWITCH if frame["fd"] else FrameFlag(0),
        )
        for frame in vector["frames"]
    ]


def test_the_shipped_vectors_are_what_the_code_sends() -> None:
    assert can_vectors_text() == TEXT


@pytest.mark.parametrize("fd", [False, True])
def test_the_vectors_decode_to_their_packets(fd: bool) -> None:
    decoder = CanStreamDecoder(5)
    vectors = [vector for vector in VECTORS if vector["fd"] == fd and bytes.fromhex(vector["bytes"])[0] < 0x80]
    items = []
    for vector in vectors:
        items += decoder.feed(pack_frames(frames_of(vector)))
    expected = [decode_packet(bytes.fromhex(vector["bytes"])) for vector in vectors]
    assert len(items) == len(expected)
    for item, packet in zip(items, expected, strict=True):
        if not isinstance(packet, Orientation):
            assert item == packet
            continue
        assert isinstance(item, OrientationBatch)
        assert (item.sequence[0], item.device_time_us[0], item.flags[0]) == (
            packet.sequence,
            packet.device_time_us,
            packet.flags,
        )
        dot = abs(sum(a * b for a, b in zip(item.quats_wxyz[0], packet.q_wxyz, strict=True)))
        assert dot > 1 - 1e-10


def test_the_first_frames_are_as_the_mapping_says() -> None:
    state, time, sample = VECTORS[0]["frames"]
    assert (state["id"], time["id"], sample["id"]) == ("105", "125", "185")
    counter, flags, rate_hz, tag = struct.unpack("<IBHB", bytes.fromhex(state["data"]))
    assert (counter, flags, rate_hz) == (254, 1, 200)
    assert tag
    assert struct.unpack("<II", bytes.fromhex(time["data"])) == (254, 4_294_967_290)
    # Identity: w is left out (index 0), the three zeros are the middle code 131072 = 0x20000 in 18 bits each.
    code = 0x20000 << 36 | 0x20000 << 18 | 0x20000
    assert bytes.fromhex(sample["data"]) == bytes([254]) + code.to_bytes(7, "little")


def test_status_pages_hold_the_fields_at_their_places() -> None:
    vector = next(vector for vector in VECTORS if vector["packet"] == "STATUS" and not vector["fd"])
    pages = [bytes.fromhex(frame["data"]) for frame in vector["frames"]]
    assert [page[0] for page in pages] == [0, 1, 2, 3, 4]
    assert int.from_bytes(pages[0][1:], "little") == 2**40 + 1
    assert int.from_bytes(pages[1][1:], "little") == 2**33
    assert struct.unpack_from("<IBH", pages[2], 1) == (17, 1, 8)
    assert struct.unpack_from("<Hhh", pages[3], 1) == (3712, -1234, 1)
    assert struct.unpack_from("<hh", pages[4], 1) == (-1500, 32000)


@pytest.mark.parametrize("fd", [False, True])
def test_info_goes_by_iso_tp_as_the_standard_says(fd: bool) -> None:
    vector = next(vector for vector in VECTORS if vector["packet"] == "INFO" and vector["fd"] == fd)
    packet = bytes.fromhex(vector["bytes"])
    first, flow_control, *rest = frames_of(vector)
    longest = 64 if fd else 8
    assert [frame.arbitration_id & 0x3FF for frame in (first, flow_control)] == [0x325, 0x305]
    assert {frame.arbitration_id & 0x400 for frame in (first, flow_control, *rest)} == {0x400 * fd}
    assert int.from_bytes(first.data[:2], "big") == 0x1000 | len(packet)
    assert flow_control.data[:3] == b"\x30\x00\x00"  # go on, all at once, without pauses
    assert [frame.data[0] for frame in rest] == [0x20 | (1 + k) & 15 for k in range(len(rest))]
    joined = first.data[2:] + b"".join(frame.data[1:] for frame in rest)
    assert joined[: len(packet)] == packet
    assert len(first.data) == len(rest[0].data) == longest


def test_fd_frames_are_a_length_the_packet_and_zeros() -> None:
    for vector in (vector for vector in VECTORS if vector["fd"] and vector["packet"] != "INFO"):
        frame = frames_of(vector)[-1]
        packet = bytes.fromhex(vector["bytes"])
        assert frame.arbitration_id & 0x400
        assert frame.data[0] == len(packet)
        assert frame.data[1 : 1 + len(packet)] == packet
        assert not any(frame.data[1 + len(packet) :])
