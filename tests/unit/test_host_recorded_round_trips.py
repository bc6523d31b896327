"""TIME_REQUEST and TIME_REPLY found again in a recording, whatever the chunks are, on serial lines and on CAN."""

from dataclasses import replace

import numpy as np
import pytest

from firmware_protocol.can.frames import FrameFlag, pack_frames
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import TimeReply, TimeRequest
from firmware_protocol.serial.decoder import encode_command
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk, FrameChunk
from host.recording.arrivals import RecordedRoundTrips
from host.recording.assembly import TrialAssembly
from host.recording.load import load_trial
from host.recording.writer import RecordingWriter
from tests.can_traffic import object_at, timed
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario, virtual_chunks

MS = 1_000_000
REPLIES = [TimeReply(7, 5_000_000, 5_000_050), TimeReply(8, 2**40, 2**40 + 90)]


def found(chunks, sent):
    trips = RecordedRoundTrips()
    for data, at_ns in sent:
        trips.feed_sent(data, at_ns)
    TrialAssembly(None, trips, lambda: 0.0).feed(chunks)
    result = trips.round_trips()
    return [column.tolist() for column in (result.sent_ns, result.receive_us, result.transmit_us, result.received_ns)]


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_a_reply_arrived_with_the_chunk_that_completed_it(size):
    data = b"\1junk\0".join(encode_frame(encode_packet(reply)) for reply in REPLIES)
    chunks = [Chunk(data[at : at + size], 100 * MS + at * MS) for at in range(0, len(data), size)]
    sent = [(encode_command(TimeRequest(7)), 90 * MS), (encode_command(TimeRequest(8)), 95 * MS), (b"\0junk\0", 99)]
    sent_ns, receive_us, transmit_us, received_ns = found(chunks, sent)
    assert sent_ns == [90 * MS, 95 * MS]
    assert receive_us == [5_000_000, 2**40]
    assert transmit_us == [5_000_050, 2**40 + 90]
    ends = [len(encode_frame(encode_packet(REPLIES[0]))), len(data)]
    assert received_ns == [chunks[(end - 1) // size].host_time_ns for end in ends]


def test_the_request_is_the_last_one_of_its_number_before_the_reply():
    sent = [(encode_command(TimeRequest(7)), at_ns) for at_ns in (1 * MS, 50 * MS, 500 * MS)]
    chunk = Chunk(encode_frame(encode_packet(REPLIES[0])), 60 * MS)
    assert found([chunk], sent)[0] == [50 * MS]
    assert found([chunk], [])[0] == []


def test_on_can_the_last_frame_of_the_reply_counts():
    frames = timed(object_at(), [encode_packet(REPLIES[0])], period_ns=MS)
    chunk = FrameChunk(pack_frames(frames), frames[-1].host_time_ns + 40 * MS)
    sent_ns, _, transmit_us, received_ns = found([chunk], [(encode_packet(TimeRequest(7)), 5)])
    assert (sent_ns, transmit_us) == ([5], [5_000_050])
    assert received_ns == [frames[-1].host_time_ns]


@pytest.mark.parametrize("flag", [FrameFlag.SENT, FrameFlag.ERROR, FrameFlag.REMOTE, FrameFlag.EXTENDED])
def test_on_can_a_later_frame_that_is_no_reply_does_not_count(flag):
    frames = timed(object_at(), [encode_packet(REPLIES[0])], period_ns=MS)
    later = replace(frames[-1], flags=flag, data=b"", host_time_ns=frames[-1].host_time_ns + 20 * MS)
    chunk = FrameChunk(pack_frames([*frames, later]), later.host_time_ns)
    assert found([chunk], [(encode_packet(TimeRequest(7)), 5)])[3] == [frames[-1].host_time_ns]


def test_a_recording_with_round_trips_gives_the_offset_as_an_interval(tmp_path):
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=20.0)
    writer = RecordingWriter(tmp_path / "x.mcap", "memory:", WALL_NS, MONOTONIC_NS)
    for number, chunk in enumerate(chunks):
        if number % 100 == 50:  # an object that answers within the chunk before: 2 ms each way
            clock_us = (chunk.host_time_ns - MONOTONIC_NS) // 1000
            reply = encode_frame(encode_packet(TimeReply(number % 256, clock_us - 2000, clock_us - 2000)))
            writer.add_sent(encode_command(TimeRequest(number % 256)), chunk.host_time_ns - 4 * MS)
            chunk = Chunk(chunk.data + reply, chunk.host_time_ns)
        writer.add_received(chunk)
    writer.close()
    clock = load_trial(tmp_path / "x.mcap").clock
    low_ms, high_ms = clock.mapped_time_error_ms
    assert clock.round_trips == 20
    assert clock.offset_interval_ms[0] <= clock.offset_ms + 1e-6
    assert np.diff(clock.offset_interval_ms) == pytest.approx(high_ms - low_ms, abs=1e-4)
    assert 0 < high_ms - low_ms < 15.0
