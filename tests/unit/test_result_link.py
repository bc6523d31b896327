"""Every counter of a decoder reaches the result of a recording in which it happened."""

from dataclasses import fields, replace

import pytest

from analysis.scoring.recorded_parts import LinkAccount
from firmware_protocol.can.counters import CanCounters
from firmware_protocol.can.frames import CanFrame, FrameFlag, pack_frames
from firmware_protocol.can.mapping import CanFunction, arbitration_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Mark
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk, FrameChunk
from host.recording.load import load_trial
from host.recording.writer import RecordingWriter
from host.results.result import score_trial
from tests.can_traffic import is_sample, object_at, sample_packets, sample_rows, timed
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario, virtual_chunks

MS = 1_000_000
NODE = 3


def link_of_recording(folder, chunks):
    """Record, read and score; return what the result holds of the link."""
    path = folder / "trial.mcap"
    writer = RecordingWriter(path, "memory:", WALL_NS, MONOTONIC_NS)
    for chunk in chunks:
        writer.add_received(chunk)
    writer.close()
    link = score_trial(load_trial(path)).link
    assert isinstance(link, LinkAccount)
    return link


def traffic(n=2000, **about):
    return timed(object_at(NODE), sample_packets(n, **about), MS, MONOTONIC_NS)


def chunks_of(frames, at_once=1):
    groups = [frames[first : first + at_once] for first in range(0, len(frames), at_once)]
    return [FrameChunk(pack_frames(group), group[-1].host_time_ns) for group in groups]


def with_strangers(*strangers):
    """Return a trial's traffic with other frames in its middle."""
    frames = traffic()
    at_ns = frames[1000].host_time_ns
    return chunks_of([*frames[:1000], *(replace(frame, host_time_ns=at_ns) for frame in strangers), *frames[1000:]])


def without_time_frames():
    return chunks_of([frame for frame in traffic() if is_sample(frame)])


def with_a_loss_seen_too_late():
    """Return traffic with 256 samples lost in a silence too short to be suspected.

    The eight bits of the counter fit as if nothing were missing, and the frames come ten at a time: 54 samples lie
    between the silence and the next TIME frame.
    """
    frames = traffic()
    rows = sample_rows(frames)
    later = [replace(frame, host_time_ns=frame.host_time_ns - 156 * MS) for frame in frames[rows[900] :]]
    return chunks_of(frames[: rows[644]] + later, at_once=10)


def of_two_objects():
    second = timed(object_at(NODE, device_id=2), sample_packets(2000, first=40_000), MS, MONOTONIC_NS)
    return chunks_of(sorted(traffic() + second, key=lambda frame: frame.host_time_ns))


def with_a_damaged_batch():
    chunks = chunks_of(traffic())
    return [*chunks[:1000], FrameChunk(b"CF\x01\x08\x01\x00\x00\x00", chunks[1000].host_time_ns), *chunks[1000:]]


def of_ours(function, data, node=NODE, flags=0):
    return CanFrame(arbitration_id(function, node), data, FrameFlag(flags))


ON_THE_BUS = {
    "unnumbered": (without_time_frames, 2000),
    "misnumbered": (with_a_loss_seen_too_late, 54),
    "damaged_batches": (with_a_damaged_batch, 1),
    "refused": (of_two_objects, None),
    "wrong_lengths": (lambda: with_strangers(of_ours(CanFunction.TIME, bytes(3))), 1),
    "long_packet_errors": (
        lambda: with_strangers(
            of_ours(CanFunction.LONG_FROM_OBJECT, b"\x10\x20" + bytes(6)),
            of_ours(CanFunction.LONG_FROM_OBJECT, b"\x27" + bytes(7)),
        ),
        1,
    ),
    "error_frames": (lambda: with_strangers(CanFrame(0x04, bytes(8), FrameFlag.ERROR)), 1),
    "remote_frames": (
        lambda: with_strangers(
            CanFrame(arbitration_id(CanFunction.ORIENTATION, NODE), b"", FrameFlag.REMOTE, remote_length=8)
        ),
        1,
    ),
    "foreign_frames": (lambda: with_strangers(CanFrame(0x001, b"1"), CanFrame(0x7FF, bytes(8))), 2),
    "other_node_frames": (lambda: with_strangers(of_ours(CanFunction.ORIENTATION, bytes(8), node=9)), 1),
    "host_frames": (lambda: with_strangers(of_ours(CanFunction.COMMAND, b"\x81\x01")), 1),
}


@pytest.mark.parametrize("name", ON_THE_BUS)
def test_what_a_can_decoder_counts_is_in_the_result(tmp_path, name):
    make, expected = ON_THE_BUS[name]
    counted = getattr(link_of_recording(tmp_path, make()), name)
    assert counted == expected if expected is not None else counted > 0


BYTES = {
    "crc_errors": (lambda: b"\0" + encode_frame(encode_packet(Mark(1, 2)))[:-2] + b"\x01\0", 1),
    "cobs_errors": (lambda: b"\0\xff\x01\0", 1),
    "oversize": (lambda: b"\0" + b"\x01" * 2000 + b"\0", 1),
    "unknown_types": (lambda: encode_frame(b"\x7f" + bytes(8)), 1),
    "malformed": (lambda: encode_frame(bytes([1])), 1),
}


@pytest.mark.parametrize("name", BYTES)
def test_what_a_serial_decoder_counts_is_in_the_result(tmp_path, name):
    make, expected = BYTES[name]
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=2.0)
    link = link_of_recording(tmp_path, [*chunks[:50], Chunk(make(), chunks[50].host_time_ns), *chunks[50:]])
    assert getattr(link, name) == expected
    assert link.packets["orientation"] > 100
    assert link.bytes == sum(len(chunk.data) for chunk in chunks) + len(make())


def test_every_counter_has_a_place_in_the_result():
    counters = {item.name for item in fields(CanCounters)}
    assert counters <= set(LinkAccount.__struct_fields__)


def test_a_serial_link_has_none_of_the_counters_of_a_bus(tmp_path):
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=2.0)
    link = link_of_recording(tmp_path, chunks)
    assert {name for name in ON_THE_BUS if getattr(link, name) is not None} == set()
