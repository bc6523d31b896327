"""What a decoder counts reaches the line of the link: one fault a counter, made on the wire, seen on the screen."""

import dataclasses

import pytest

from firmware_protocol.can.counters import CanCounters
from firmware_protocol.can.frames import CanFrame, FrameFlag, pack_frames
from firmware_protocol.can.mapping import CanFunction, arbitration_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Info, Orientation
from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk, FrameChunk
from host.screen.dashboard.status_panel import COUNTERS, status_panel
from host.screen.dashboard.theme import Theme
from host.trial.live import Trial
from host.trial.state import CounterView, LinkView, StreamView, TrialState
from tests.can_traffic import is_sample, object_at, sample_packets, sample_rows, timed

NODE, MS = 3, 1_000_000
ORDINARY = {
    *("bytes", "delimiters", "frames", "frame_bytes", "packets", "pending_bytes", "skipped_bytes", "partial_starts"),
    *("extended", "foreign_frames", "host_frames", "other_node_frames"),
}
"""Counters that a good link has too, and a bus with other devices on it: not shown."""
IN_LOSSES = {"crc_errors", "malformed"}
SAMPLE = encode_packet(Orientation(1, 2, (1.0, 0.0, 0.0, 0.0)))
INFO = encode_packet(Info(device_id=1, boot_id=2))


def of_bytes(*pieces):
    """What a trial shows of a serial link that sent these pieces after a good frame."""
    data = encode_frame(SAMPLE) + b"".join(pieces)
    return shown([Chunk(data, MS)])


def of_frames(frames, at_once=5):
    chunks = [pack_frames(frames[k : k + at_once]) for k in range(0, len(frames), at_once)]
    return shown([FrameChunk(chunk, k * MS) for k, chunk in enumerate(chunks)])


def shown(chunks):
    trial = Trial(NODE)
    for chunk in chunks:
        trial.feed(chunk)
    trial.finish()
    return lines_of(trial.stream_view(chunks[-1].host_time_ns))


def lines_of(stream, link=LinkView("can:x")):  # noqa: B008 - frozen
    panel = status_panel(TrialState(stream=stream, link=link), Theme(), 120)
    lines = {line.plain[2:12].strip(): line.plain for line in panel}
    return f"{lines['link']} {lines['losses']}"


def frame(function, data, **more):
    return CanFrame(arbitration_id(function, NODE), data, **more)


def traffic(**info):
    return timed(object_at(NODE, **info), sample_packets(2000), MS)


def misnumbered():
    """256 samples lost in a row, so that the eight bits go on, and read too late for the silence to show."""
    frames = traffic()
    rows = sample_rows(frames)
    kept = frames[: rows[970]] + frames[rows[970 + 255] + 1 :]
    return [
        dataclasses.replace(frame, host_time_ns=frame.host_time_ns - 236 * MS)
        if frame.host_time_ns > (1000 + 970) * MS
        else frame
        for frame in kept
    ]


def two_with_one_id():
    both = traffic(device_id=1) + timed(object_at(NODE, device_id=2), sample_packets(2000, first=40_000), MS)
    return sorted(both, key=lambda frame: frame.host_time_ns)


OUT_OF_TURN = [frame(CanFunction.LONG_FROM_OBJECT, data) for data in (b"\x10\x14ABCDEF", b"\x29GHIJKLM")]
SHOWN = {
    "cobs_errors": lambda: of_bytes(b"\x05\x01\x00"),
    "oversize": lambda: of_bytes(b"\x01" * 5000 + b"\x00"),
    "unsupported_versions": lambda: of_bytes(encode_frame(INFO[:1] + b"\x09" + INFO[2:])),
    "unknown_types": lambda: of_bytes(encode_frame(b"\x7e\x01\x02")),
    "error_frames": lambda: of_frames([CanFrame(0x04, bytes(8), FrameFlag.ERROR)]),
    "remote_frames": lambda: of_frames([frame(CanFunction.ORIENTATION, b"", flags=FrameFlag.REMOTE, remote_length=8)]),
    "wrong_lengths": lambda: of_frames([frame(CanFunction.ORIENTATION, bytes(7))]),
    "damaged_batches": lambda: shown([FrameChunk(b"XX", MS)]),
    "long_packet_errors": lambda: of_frames(OUT_OF_TURN),
    "unnumbered": lambda: of_frames([frame for frame in traffic() if is_sample(frame)]),
    "misnumbered": lambda: of_frames(misnumbered(), 20),
    "refused": lambda: of_frames(two_with_one_id()),
}


@pytest.mark.parametrize("counter", SHOWN)
def test_a_fault_on_the_wire_is_seen_in_the_line_of_the_link(counter):
    name = COUNTERS[counter]
    seen = SHOWN[counter]()
    assert f"· {name} " in seen
    n = int(seen.split(f"· {name} ")[1].split()[0])
    assert n >= 1
    for other in set(COUNTERS.values()) - {
        name,
        "unnumbered",
    }:  # before the first TIME frame there may be some of these
        assert f"· {other} " not in seen
    assert f"{name} " not in lines_of(StreamView())


def test_every_counter_is_shown_or_ordinary():
    counters = {field.name for field in dataclasses.fields(CanCounters)}
    viewed = {field.name for field in dataclasses.fields(CounterView)}
    assert viewed == set(COUNTERS) | IN_LOSSES
    assert set(SHOWN) == set(COUNTERS)
    assert counters == viewed | ORDINARY
