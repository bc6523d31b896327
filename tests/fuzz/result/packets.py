"""Mutations of a session, packet by packet: what goes on the line has the right CRC, length and framing.

So nothing is stopped at the checksum, and odd values reach clock, ledger, cycles and score. A part of the inputs is
damaged afterwards as well, as lines damage: then samples are rejected in between.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random

from firmware_protocol.packets import PacketType
from firmware_protocol.serial.framing import MAX_PACKET_BYTES, encode_frame
from host.links.transport import Chunk
from tests.fuzz.result.layouts import edge_integer, packet_fields
from tests.fuzz.result.sessions import Session, sessions
from tests.recorded_trials import MONOTONIC_NS

MAX_PACKETS = 1200
"""An input has at most so many: what is doubled again and again takes time and finds nothing more."""
SAMPLE_FIELDS = {field.name: field for field in packet_fields(PacketType.ORIENTATION)}
CLOCK_FIELDS = ("device_time_us", "uptime_us", "receive_uptime_us", "transmit_uptime_us")
NUMBER_FIELDS = ("sequence", "samples_produced")
CLOCK_STEPS_US = (1, 1000, 10**5, 10**6, 5 * 10**6, 60 * 10**6, 3600 * 10**6, 2**31 - 1, 2**31, 2**32 - 1000, 2**40)
NUMBER_STEPS = (1, 2, 63, 64, 65, 1000, 2**15 - 1, 2**15, 2**16 - 1, 2**16, 2**32, 2**40, 2**63)
PAUSES_NS = (0, 1, 10**6, 10**8, 10**9, 2 * 10**9, 10**10, 60 * 10**9, 3600 * 10**9, 4295 * 10**9, 10**15)


@dataclass
class Delivered:
    """A packet under way."""

    packet: bytearray
    time_ns: int
    """Host time of the read that brings it; never before that of the one in front."""
    cut: bool = False
    """Whether the link was lost and opened again just before it."""


def delivered(session: Session) -> list[Delivered]:
    """Return the packets of a session as they were delivered."""
    return [Delivered(bytearray(packet), each.host_time_ns) for each in session.deliveries for packet in each.packets]


def mutated(rng: Random) -> tuple[Session, list[Delivered]]:
    """Return a session and what becomes of its packets."""
    session = rng.choice(sessions())
    line = delivered(session)
    for _ in range(1 + min(int(rng.expovariate(0.45)), 8)):
        rng.choice(MUTATIONS)(line, rng)
        del line[MAX_PACKETS:]
        if not line:
            break
    return session, line


def some(line: Sequence[object], rng: Random, longest: int = 40) -> slice:
    """Return a part of a line, mostly short."""
    start = rng.randrange(len(line) + 1)
    return slice(start, start + rng.choice((1, 1, 2, 3, 10, rng.randrange(1, max(longest, 2)))))


def _one_field(line: list[Delivered], rng: Random) -> None:
    """An edge value in one field of one packet; types that are rare are as likely as samples."""
    kind = rng.choice(sorted({each.packet[0] for each in line if each.packet}))
    of_kind = [each for each in line if each.packet[:1] == bytes([kind])]
    fields = packet_fields(kind)
    if fields:
        chosen = rng.choice(of_kind).packet
        field = rng.choice(fields)
        if len(chosen) >= field.offset + field.size:
            field.edge(chosen, rng)


def _all_fields(line: list[Delivered], rng: Random) -> None:
    """A packet of edge values only, put in anywhere."""
    kind = rng.choice(list(PacketType))
    fields = packet_fields(kind)
    packet = bytearray(1 + sum(field.size for field in fields))
    packet[0] = kind
    for field in fields:
        field.edge(packet, rng)
    at = rng.randrange(len(line))
    line.insert(at, Delivered(packet, line[at].time_ns))


def _field_from_here_on(line: list[Delivered], rng: Random) -> None:
    """The same edge value in a field of all packets of a type from somewhere on, as a broken firmware sends it."""
    at = rng.randrange(len(line))
    kind = line[at].packet[0] if line[at].packet else 0
    fields = packet_fields(kind)
    if not fields:
        return
    field = rng.choice(fields)
    value: bytes | None = None
    for each in line[at : at + rng.choice((3, 20, len(line)))]:
        if each.packet[:1] == bytes([kind]) and len(each.packet) >= field.offset + field.size:
            if value is None:
                field.edge(each.packet, rng)
                value = bytes(each.packet[field.offset : field.offset + field.size])
            each.packet[field.offset : field.offset + field.size] = value


def shift_fields(line: Sequence[Delivered], names: Sequence[str], step: int) -> None:
    """Add to the fields of these names in all packets."""
    for each in line:
        for field in packet_fields(each.packet[0] if each.packet else 0):
            if field.name in names and len(each.packet) >= field.offset + field.size:
                field.shift(each.packet, step)


def _clock_steps(line: list[Delivered], rng: Random) -> None:
    """The device clock jumps, or all of it lies elsewhere: near its wrap, for instance."""
    start = rng.choice((0, rng.randrange(len(line))))
    shift_fields(line[start:], CLOCK_FIELDS, rng.choice((-1, 1)) * rng.choice(CLOCK_STEPS_US))


def _numbers_step(line: list[Delivered], rng: Random) -> None:
    """Sample numbers jump, in samples, in STATUS, or in both."""
    start = rng.choice((0, rng.randrange(len(line))))
    names = rng.choice((NUMBER_FIELDS, NUMBER_FIELDS[:1], NUMBER_FIELDS[1:], ("samples_dropped",)))
    shift_fields(line[start:], names, rng.choice((-1, 1)) * rng.choice(NUMBER_STEPS))


def _wraps_here(line: list[Delivered], rng: Random) -> None:
    """Clock or number wrap within the session."""
    samples = [each for each in line if each.packet[:1] == b"\x02" and len(each.packet) >= 16]
    if samples:
        chosen = rng.choice(samples).packet
        name, others = rng.choice((("sequence", NUMBER_FIELDS), ("device_time_us", CLOCK_FIELDS)))
        shift_fields(line, others, -int(SAMPLE_FIELDS[name].read(chosen)))


def _starts_again(line: list[Delivered], rng: Random) -> None:
    """From somewhere on all comes from another boot, told by INFO or not."""
    at = rng.randrange(len(line))
    other = delivered(rng.choice(sessions()[:2]))
    shift_times(other, line[at].time_ns - other[0].time_ns)
    line[at:] = other if rng.random() < 0.5 else [each for each in other if each.packet[0] != PacketType.INFO]


def _dropped(line: list[Delivered], rng: Random) -> None:
    del line[some(line, rng)]


def _of_a_type_dropped(line: list[Delivered], rng: Random) -> None:
    kind, share = rng.choice(list(PacketType)), rng.choice((0.1, 0.5, 1.0))
    line[:] = [each for each in line if each.packet[:1] != bytes([kind]) or rng.random() > share]


def _doubled(line: list[Delivered], rng: Random) -> None:
    part = line[some(line, rng)]
    _put_in(line, part, rng.choice((rng.randrange(len(line) + 1), line.index(part[-1]) + 1 if part else 0)))


def _swapped(line: list[Delivered], rng: Random) -> None:
    part = some(line, rng, 12)
    packets = [each.packet for each in line[part]]
    rng.choice((rng.shuffle, list.reverse))(packets)
    for each, packet in zip(line[part], packets, strict=True):
        each.packet = packet


def _spliced(line: list[Delivered], rng: Random) -> None:
    """A part of another session in between, with its own numbers and times."""
    other = delivered(rng.choice(sessions()))
    _put_in(line, other[some(other, rng, 100)], rng.randrange(len(line) + 1))


def _interleaved(line: list[Delivered], rng: Random) -> None:
    """Two objects on one line."""
    other = delivered(rng.choice(sessions()))
    line[:] = sorted([*line, *other[some(other, rng, len(other))]], key=lambda each: each.time_ns)


def _put_in(line: list[Delivered], part: Sequence[Delivered], at: int) -> None:
    """Put packets in at a place; they come when those around them do."""
    time_ns = line[min(at, len(line) - 1)].time_ns if line else MONOTONIC_NS
    line[at:at] = [Delivered(bytearray(each.packet), time_ns) for each in part]


def _another_length(line: list[Delivered], rng: Random) -> None:
    """A packet with fields of a newer version behind it, or cut short, or empty."""
    each = rng.choice(line)
    if rng.random() < 0.5:
        each.packet += rng.randbytes(rng.choice((1, 2, 8, 100)))
        del each.packet[MAX_PACKET_BYTES:]
    else:
        del each.packet[rng.randrange(len(each.packet) + 1) :]


def _another_type(line: list[Delivered], rng: Random) -> None:
    rng.choice(line).packet[:1] = bytes([rng.choice((*PacketType, 0, 0x08, 0x7F, 0x80, 0xFF))])


def shift_times(line: Sequence[Delivered], step_ns: int) -> None:
    """Let packets come earlier or later."""
    for each in line:
        each.time_ns += step_ns


def _pause(line: list[Delivered], rng: Random) -> None:
    """Nothing comes for a while, or much at once after it."""
    at = rng.randrange(len(line))
    pause_ns = rng.choice(PAUSES_NS)
    shift_times(line[at:], pause_ns)
    if rng.random() < 0.5:
        for each in line[max(at - rng.randrange(20), 0) : at]:
            each.time_ns = line[at].time_ns


def _all_at_once(line: list[Delivered], rng: Random) -> None:
    """Reads that bring very much, or one packet each."""
    if rng.random() < 0.5:
        for number, each in enumerate(line):
            each.time_ns = line[0].time_ns + number * 10**6
    else:
        part = line[some(line, rng, len(line))]
        for each in part:
            each.time_ns = part[-1].time_ns


def _link_cut(line: list[Delivered], rng: Random) -> None:
    rng.choice(line).cut = True


def _other_rotations(line: list[Delivered], rng: Random) -> None:
    """Orientations that stand still, turn over, jump, or are no rotations."""
    part = line[some(line, rng, len(line))]
    fields = [SAMPLE_FIELDS[f"q_wxyz[{axis}]"] for axis in range(4)]
    kind, first = rng.randrange(5), None
    for each in part:
        if each.packet[:1] != b"\x02" or len(each.packet) < 16:
            continue
        now = [int(field.read(each.packet)) for field in fields]
        first = first or now
        signs = [rng.choice((-1, 1)) for _ in now]
        values = (
            first,
            [-value for value in now],
            [value * sign for value, sign in zip(now, signs, strict=True)],
            [edge_integer(rng, -0x8000, 0x7FFF, value) for value in now],
            now[1:] + now[:1],
        )[kind]
        for field, value in zip(fields, values, strict=True):
            field.write(each.packet, max(-0x8000, min(0x7FFF, value)))


MUTATIONS: tuple[Callable[[list[Delivered], Random], None], ...] = (
    _one_field,
    _one_field,
    _one_field,
    _all_fields,
    _field_from_here_on,
    _clock_steps,
    _numbers_step,
    _wraps_here,
    _starts_again,
    _dropped,
    _of_a_type_dropped,
    _doubled,
    _swapped,
    _spliced,
    _interleaved,
    _another_length,
    _another_type,
    _pause,
    _all_at_once,
    _link_cut,
    _other_rotations,
)


def in_reads(line: Sequence[Delivered]) -> list[list[Delivered]]:
    """Return the packets read by read; host time never goes back, as a monotonic clock does not."""
    reads: list[list[Delivered]] = []
    now_ns = 0
    for each in line:
        now_ns = max(now_ns, each.time_ns)
        if not reads or each.cut or reads[-1][0].time_ns != now_ns:
            reads.append([])
        each.time_ns = now_ns
        reads[-1].append(each)
    return reads


def serial_chunks(line: Sequence[Delivered], rng: Random) -> tuple[list[Chunk], int | None]:
    """Return packets as the reads of a serial link, and how many frames are whole.

    In some inputs frames are damaged, as on a bad line, so that nobody knows; in some, reads end within frames.
    """
    chunks: list[Chunk] = []
    n_frames, damage = 0, rng.choice((0.0, 0.0, 0.0, 0.02, 0.1))
    rest, split = b"", rng.random() < 0.3
    for packets in in_reads(line):
        if packets[0].cut:
            chunks.append(Chunk(b"", packets[0].time_ns))
            rest = b""
        frames = [encode_frame(bytes(each.packet)) for each in packets if each.packet]
        n_frames += len(frames)
        data = rest + b"".join(_damaged(frame, rng) if rng.random() < damage else frame for frame in frames)
        at = rng.randrange(1, len(data)) if split and len(data) > 1 else len(data)
        rest = data[at:]
        if data:
            chunks.append(Chunk(data[:at], packets[0].time_ns))
    if rest:
        chunks.append(Chunk(rest, chunks[-1].host_time_ns))
    exact = not damage and not (split and any(not chunk.data for chunk in chunks))
    return chunks, n_frames if exact else None


def _damaged(frame: bytes, rng: Random) -> bytes:
    """Return a frame as a bad line delivers it."""
    hurt, at = bytearray(frame), rng.randrange(len(frame))
    kind = rng.randrange(5)
    if kind == 0:
        hurt[at] ^= 1 << rng.randrange(8)
    elif kind == 1:
        del hurt[at : at + rng.choice((1, 2, 20))]
    elif kind == 2:
        hurt[at:at] = rng.randbytes(rng.choice((1, 2, 20, 300)))
    elif kind == 3:
        hurt[at:] = bytes(len(hurt) - at)
    else:
        hurt += b"text of a bootloader\r\n"
    return bytes(hurt)
