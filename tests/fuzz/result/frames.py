"""Mutations of a session on a CAN bus, frame by frame; fields are those of the published DBC file.

A frame has no checksum of its own here: the controllers of the bus have seen to that. What must fit all the same are
lengths, the identifiers and the head of a batch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from random import Random

from firmware_protocol.can.encoder import CanObject
from firmware_protocol.can.frames import FD_LENGTHS, CanFrame, FrameFlag, fd_padded, pack_frames
from firmware_protocol.can.mapping import NODE_BITS, NODE_MASK, CanFunction, arbitration_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Info
from host.links.transport import Chunk, FrameChunk
from tests.fuzz.result.layouts import FrameField, edge_integer, frame_fields, packet_fields
from tests.fuzz.result.packets import CLOCK_STEPS_US, NUMBER_STEPS, PAUSES_NS, some
from tests.fuzz.result.sessions import Session, sessions

NODE, OTHER_NODE = 3, 4
MAX_FRAMES = 1500
CLOCK_SIGNALS = ("DeviceTimeUs", "UptimeUs", "ReceiveUptimeUs", "TransmitUptimeUs")
NUMBER_SIGNALS = ("SampleCounter", "SampleCounter8", "Sequence", "SamplesProduced")
Line = list["Heard"]


@dataclass
class Heard:
    """A frame under way."""

    frame: CanFrame
    cut: bool = False
    """Whether the link was lost and opened again just before it."""


class FreeObject(CanObject):
    """An object whose long packets need no answers: their frames follow each other as ISO-TP has them."""

    def _long(self, packet: bytes) -> list[CanFrame]:
        identifier = arbitration_id(CanFunction.LONG_FROM_OBJECT, self.node, self.fd)
        flags = FrameFlag.FD | FrameFlag.BITRATE_SWITCH if self.fd else FrameFlag(0)
        width = 64 if self.fd else 8
        parts = [(0x1000 | len(packet)).to_bytes(2, "big") + packet[: width - 2]]
        rest = packet[width - 2 :]
        for number in range(-(-len(rest) // (width - 1))):
            part = rest[number * (width - 1) : (number + 1) * (width - 1)]
            parts.append(bytes([0x20 | (number + 1) & 0xF]) + part)
        padded = [fd_padded(part) if self.fd else part.ljust(8, b"\xcc") for part in parts]
        return [CanFrame(identifier, part, flags) for part in padded]


@cache
def heard(session: Session, fd: bool, node: int) -> tuple[CanFrame, ...]:
    """Return the frames of a session, each with the time of the read that brings it."""
    end = FreeObject(node, fd)
    return tuple(
        replace(frame, host_time_ns=each.host_time_ns, interface_time_s=each.host_time_ns / 1e9)
        for each in session.deliveries
        for frame in end.encode(each.packets)
    )


def mutated(rng: Random) -> tuple[Session, Line]:
    """Return a session and what becomes of its frames."""
    session, fd = rng.choice(sessions()), rng.random() < 0.35
    line = [Heard(frame) for frame in heard(session, fd, NODE)]
    for _ in range(1 + min(int(rng.expovariate(0.45)), 8)):
        rng.choice(MUTATIONS)(line, rng)
        del line[MAX_FRAMES:]
        if not line:
            break
    return session, line


def _upper(frame: CanFrame) -> int:
    return frame.arbitration_id >> NODE_BITS


def _fields(frame: CanFrame) -> list[FrameField]:
    return [field for field in frame_fields().get(_upper(frame), ()) if field.start < 8 * len(frame.data)]


def _one_field(line: Line, rng: Random) -> None:
    """An edge value in one signal of one frame; functions that are rare are as likely as samples."""
    upper = rng.choice(sorted({_upper(each.frame) for each in line}))
    chosen = rng.choice([each for each in line if _upper(each.frame) == upper])
    fields = _fields(chosen.frame)
    fields = [field for field in fields if field.is_in(chosen.frame.data)] or fields
    if fields:
        chosen.frame = replace(chosen.frame, data=rng.choice(fields).edge(chosen.frame.data, rng))


def _field_from_here_on(line: Line, rng: Random) -> None:
    """The same edge value in a signal of all its frames from somewhere on."""
    at = rng.randrange(len(line))
    fields = _fields(line[at].frame)
    if not fields:
        return
    field, upper, value = rng.choice(fields), _upper(line[at].frame), None
    for each in line[at : at + rng.choice((3, 20, len(line)))]:
        data = each.frame.data
        if _upper(each.frame) == upper and field.is_in(data) and field.start < 8 * len(data):
            if value is None:
                value = field.read(field.edge(data, rng))
            each.frame = replace(each.frame, data=field.write(data, value))


def _shift(line: Sequence[Heard], names: Sequence[str], step: int) -> None:
    for each in line:
        for field in _fields(each.frame):
            if field.name in names and field.is_in(each.frame.data):
                each.frame = replace(each.frame, data=field.shift(each.frame.data, step))


def _clock_steps(line: Line, rng: Random) -> None:
    start = rng.choice((0, rng.randrange(len(line))))
    _shift(line[start:], CLOCK_SIGNALS, rng.choice((-1, 1)) * rng.choice(CLOCK_STEPS_US))


def _numbers_step(line: Line, rng: Random) -> None:
    """Sample numbers jump, in all frames or in some that should agree with the others."""
    start = rng.choice((0, rng.randrange(len(line))))
    names = rng.choice((NUMBER_SIGNALS, *((name,) for name in NUMBER_SIGNALS), ("SamplesDropped",)))
    _shift(line[start:], names, rng.choice((-1, 1)) * rng.choice(NUMBER_STEPS))


def _wraps_here(line: Line, rng: Random) -> None:
    """Clock or counter wrap within the session."""
    times = [each.frame for each in line if _upper(each.frame) == CanFunction.TIME and len(each.frame.data) == 8]
    if times:
        data = rng.choice(times).data
        name, others = rng.choice((("SampleCounter", NUMBER_SIGNALS), ("DeviceTimeUs", CLOCK_SIGNALS)))
        (field,) = (field for field in frame_fields()[CanFunction.TIME] if field.name == name)
        _shift(line, others, rng.randrange(10) - field.read(data))


def _another_info(line: Line, rng: Random) -> None:
    """Another INFO on the way: of the object, with an edge value in it, or of one that booted again."""
    info = Info(device_id=rng.choice((0xA1, 0xB2)), boot_id=rng.randrange(3), rate_hz=rng.choice((10, 50, 100, 1000)))
    packet = bytearray(encode_packet(info))
    for _ in range(rng.randrange(3)):
        rng.choice(packet_fields(packet[0])).edge(packet, rng)
    at, fd = rng.randrange(len(line)), rng.random() < 0.5
    frames = FreeObject(NODE, fd)._long(bytes(packet))
    _put_in(line, [Heard(frame) for frame in frames], at)


def _dropped(line: Line, rng: Random) -> None:
    del line[some(line, rng)]


def _of_a_function_dropped(line: Line, rng: Random) -> None:
    upper, share = rng.choice(sorted({_upper(each.frame) for each in line})), rng.choice((0.1, 0.5, 1.0))
    line[:] = [each for each in line if _upper(each.frame) != upper or rng.random() > share]


def _doubled(line: Line, rng: Random) -> None:
    part = line[some(line, rng)]
    _put_in(line, part, rng.choice((rng.randrange(len(line) + 1), line.index(part[-1]) + 1 if part else 0)))


def _swapped(line: Line, rng: Random) -> None:
    part = some(line, rng, 12)
    frames, times_ns = [each.frame for each in line[part]], [each.frame.host_time_ns for each in line[part]]
    rng.choice((rng.shuffle, list.reverse))(frames)
    for each, frame, time_ns in zip(line[part], frames, times_ns, strict=True):
        each.frame = replace(frame, host_time_ns=time_ns)


def _other(rng: Random) -> Line:
    node = rng.choice((NODE, NODE, OTHER_NODE))
    return [Heard(frame) for frame in heard(rng.choice(sessions()), rng.random() < 0.35, node)]


def _spliced(line: Line, rng: Random) -> None:
    other = _other(rng)
    _put_in(line, other[some(other, rng, 100)], rng.randrange(len(line) + 1))


def _interleaved(line: Line, rng: Random) -> None:
    """Two objects on one bus, with different node ids or the same."""
    other = _other(rng)
    line[:] = sorted([*line, *other[some(other, rng, len(other))]], key=lambda each: each.frame.host_time_ns)


def _starts_again(line: Line, rng: Random) -> None:
    """From somewhere on all comes from another boot."""
    at, other = rng.randrange(len(line)), _other(rng)
    step_ns = line[at].frame.host_time_ns - other[0].frame.host_time_ns
    _delay(other, step_ns)
    line[at:] = other[rng.choice((0, rng.randrange(len(other)))) :]


def _put_in(line: Line, part: Sequence[Heard], at: int) -> None:
    time_ns = line[min(at, len(line) - 1)].frame.host_time_ns if line else 0
    line[at:at] = [Heard(replace(each.frame, host_time_ns=time_ns)) for each in part]


def _another_identifier(line: Line, rng: Random) -> None:
    each = rng.choice(line)
    node = rng.choice((NODE, NODE, OTHER_NODE, 0, 31))
    upper = rng.choice((*frame_fields(), 0, 0x3F))
    found = rng.choice((upper << NODE_BITS | node, each.frame.arbitration_id & ~NODE_MASK | node, rng.randrange(2048)))
    each.frame = replace(each.frame, arbitration_id=found)


def _another_kind(line: Line, rng: Random) -> None:
    """Frames with 29-bit identifiers, remote frames, error frames, our own that come back."""
    flags = FrameFlag(rng.randrange(64))
    for each in line[some(line, rng, 10)]:
        kept = flags if len(each.frame.data) <= 8 else flags | FrameFlag.FD
        identifier = rng.choice((each.frame.arbitration_id, rng.randrange(2**29)))
        each.frame = replace(each.frame, flags=kept, arbitration_id=identifier, remote_length=rng.randrange(9))


def _another_length(line: Line, rng: Random) -> None:
    for each in line[some(line, rng, 5)]:
        length = rng.choice(FD_LENGTHS if each.frame.is_fd else range(9))
        each.frame = replace(each.frame, data=each.frame.data[:length].ljust(length, rng.choice((b"\0", b"\xff"))))


def _delay(line: Sequence[Heard], step_ns: int) -> None:
    for each in line:
        each.frame = replace(each.frame, host_time_ns=each.frame.host_time_ns + step_ns)


def _pause(line: Line, rng: Random) -> None:
    _delay(line[rng.randrange(len(line)) :], rng.choice(PAUSES_NS))


def _all_at_once(line: Line, rng: Random) -> None:
    part = line[some(line, rng, len(line))]
    for number, each in enumerate(part):
        step_ns = rng.choice((0, 10**6 * number))
        each.frame = replace(each.frame, host_time_ns=part[0].frame.host_time_ns + step_ns)


def _link_cut(line: Line, rng: Random) -> None:
    rng.choice(line).cut = True


def _other_rotations(line: Line, rng: Random) -> None:
    """Classic samples whose three components are at edges: none of it a rotation, or far from the one before."""
    for each in line[some(line, rng, len(line))]:
        if _upper(each.frame) == CanFunction.ORIENTATION and len(each.frame.data) == 8:
            code = int.from_bytes(each.frame.data[1:], "little")
            code = edge_integer(rng, 0, (1 << 56) - 1, code)
            each.frame = replace(each.frame, data=each.frame.data[:1] + code.to_bytes(7, "little"))


MUTATIONS: tuple[Callable[[Line, Random], None], ...] = (
    _one_field,
    _one_field,
    _one_field,
    _field_from_here_on,
    _clock_steps,
    _numbers_step,
    _wraps_here,
    _another_info,
    _dropped,
    _of_a_function_dropped,
    _doubled,
    _swapped,
    _spliced,
    _interleaved,
    _starts_again,
    _another_identifier,
    _another_kind,
    _another_length,
    _pause,
    _all_at_once,
    _link_cut,
    _other_rotations,
)


def can_chunks(line: Sequence[Heard], rng: Random) -> list[Chunk]:
    """Return frames as the reads of a CAN link; host time never goes back. In some inputs the reads are joined."""
    chunks: list[Chunk] = []
    read: list[CanFrame] = []
    together, now_ns = rng.choice((1, 1, 1, 4)), 0

    def deliver() -> None:
        if read:
            chunks.append(FrameChunk(pack_frames(read), read[-1].host_time_ns))
            read.clear()

    n_times = 0
    for each in line:
        new = each.frame.host_time_ns > now_ns
        now_ns = max(now_ns, each.frame.host_time_ns)
        n_times += new
        if each.cut or (new and n_times % together == 0):
            deliver()
        if each.cut:
            chunks.append(Chunk(b"", now_ns))
        read.append(replace(each.frame, host_time_ns=now_ns))
    deliver()
    return chunks
