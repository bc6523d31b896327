"""A link that knows what became of every sample, for trials with any mix of faults in virtual time.

It shares nothing with the host's ledger: it writes down what the object handed over, what went onto the wire and what
was damaged there, and counts afterwards.
"""

from __future__ import annotations

import dataclasses

from emulator.injection import FaultInjector
from emulator.links import Link as ObjectLink
from emulator.virtual_object import VirtualObject
from firmware_protocol.can.encoder import command_frame
from firmware_protocol.can.frames import pack_frames
from firmware_protocol.codec import decode_packet, encode_packet
from firmware_protocol.errors import ProtocolError
from firmware_protocol.packets import PacketType, Status
from firmware_protocol.serial.decoder import encode_command
from host.links.transport import Chunk, FrameChunk
from host.stream.decoding import Link
from host.stream.session import Session, SessionSettings
from tests.can_traffic import PatientObject, answers
from tests.faulty_trials import SETTLE_S
from tests.memory_link import MemoryLink
from tests.recorded_trials import MONOTONIC_NS

NODE = 3


class SerialSpy(MemoryLink):
    """A serial line; ``wire`` lists (packet, whether its frame was damaged)."""

    def __init__(self):
        super().__init__()
        self.wire = []

    def at(self, now_ns):
        pass

    def send(self, packets):
        tamper, damaged = self.tamper, []

        def spied(packet, frame):
            sent = tamper(packet, frame) if tamper else frame
            damaged.append(not sent.endswith(frame))
            return sent

        self.tamper = spied
        taken = super().send(packets)
        self.tamper = tamper
        self.wire += zip(packets[: taken or 0], damaged[: taken or 0], strict=True)
        return taken


class CanSpy(ObjectLink):
    """A CAN bus, classic or FD; nothing is damaged on it."""

    virtual_time = True
    host_uri = "can:memory"

    def __init__(self, fd):
        self.end, self.fd, self.wire, self.commands = PatientObject(NODE, fd), fd, [], []
        self.connected, self._now_ns, self._sent = True, 0, []

    def at(self, now_ns):
        self._now_ns = now_ns

    def open(self):
        self.connected = True

    def close(self):
        self.connected = False
        self.end.reset()
        self.commands.clear()

    def send(self, packets):
        if not self.connected:
            return None
        self._put(self.end.encode(packets))
        self.wire += [(packet, False) for packet in packets]
        return len(packets)

    def receive(self):
        found = []
        for frame in self.commands:
            packets, replies = self.end.receive(frame)
            found += packets
            self._put(replies)
        self.commands.clear()
        self._put(self.end.poll())
        return found

    def wait(self, timeout_s):
        pass

    def take(self):
        frames, self._sent = self._sent, []
        return pack_frames(frames) if frames else b""

    def _put(self, frames):
        self._sent += [dataclasses.replace(frame, host_time_ns=self._now_ns) for frame in frames]


def watched_trial(scenario, kind, seed, step_s=0.01):
    """Run a scenario without resets on ``serial``, ``can`` or ``can-fd``; return the chunks and the true account."""
    virtual = VirtualObject(scenario, seed)
    link = SerialSpy() if kind == "serial" else CanSpy(kind == "can-fd")
    link.open()
    injector, handed_over = FaultInjector(virtual, link), set()
    send = injector._send

    def spied(packets):
        taken = send(packets)
        handed_over.update(number(packet) for packet in packets[: taken or 0] if packet[0] == PacketType.ORIENTATION)
        return taken

    injector._send = spied
    is_serial = kind == "serial"
    host, encode = Link(None if is_serial else NODE), encode_command if is_serial else encode_packet
    session = Session(SessionSettings(tries=20), link.host_uri, MONOTONIC_NS, encode)
    chunks, step, was_there = [], 0, True

    def take(chunk):
        chunks.append(chunk)
        items = host.feed(chunk)
        if not is_serial:
            link.commands += answers(chunk.frames if isinstance(chunk, FrameChunk) else [])
        return items

    while step * step_s < virtual.end_s + SETTLE_S:
        step += 1
        now_ns = MONOTONIC_NS + round(step * step_s * 1e9)
        link.at(now_ns)
        injector.step(step * step_s)
        injector.receive(step * step_s)
        injector.step(step * step_s)
        data = link.take()
        if link.connected and not was_there:
            take(Chunk(b"", now_ns))
            session.reopened(now_ns)
        was_there = link.connected
        if data:
            chunk = Chunk(data, now_ns) if is_serial else FrameChunk(data, now_ns)
            session.feed(take(chunk), len(data), now_ns)
        for command in session.due(now_ns):
            if link.connected and is_serial:
                link.put_bytes(command)
            elif link.connected:
                link.commands.append(command_frame(command, NODE, link.fd))
        assert session.error is None, session.error
    return chunks, account(link.wire, handed_over)


def number(packet):
    """The sequence number of an ORIENTATION packet; trials here are shorter than its wrap."""
    return int.from_bytes(packet[1:3], "little")


def account(wire, handed_over):
    """What the host should find: every sample from the first one it can know of to the last."""
    first = None
    got, bad, last, end, told_end = set(), set(), -1, 0, 0
    duplicates = reordered = 0
    for packet, damaged in wire:
        try:
            decoded = None if damaged else decode_packet(packet)
        except ProtocolError:
            decoded = None
        if isinstance(decoded, Status):
            first = decoded.samples_produced if first is None else first
            told_end = decoded.samples_produced
        elif packet[0] == PacketType.ORIENTATION:
            here = number(packet)
            if decoded is None:
                bad.add(here)
                continue
            first = here if first is None else first
            duplicates += here in got
            reordered += here < last and here not in got
            got.add(here)
            last = max(last, here)
    end = max(last + 1, told_end)
    known = range(first, end)
    dropped = sum(each not in handed_over for each in known)
    rejected = sum(each in bad and each not in got for each in known)
    return {
        "produced": len(known),
        "received": len(got),
        "dropped": dropped,
        "rejected": rejected,
        "lost": len(known) - len(got) - dropped - rejected,
        "duplicates": duplicates,
        "reordered": reordered,
        "closed": told_end > last,
    }
