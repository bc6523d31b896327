"""Trials with faults, in virtual time: a virtual object, its faults, and the host's real session at the other end."""

from emulator.injection import FaultInjector
from emulator.virtual_object import VirtualObject
from host.links.transport import Chunk
from host.stream.decoding import Link
from host.stream.samples import SampleAssembler
from host.stream.session import Session, SessionSettings
from tests.memory_link import MemoryLink
from tests.recorded_trials import MONOTONIC_NS

SETTLE_S = 1.2
"""After the hand's time is over the object goes on for so long, so that a STATUS closes the account."""


def faulty_chunks(scenario, step_s=0.01, seed=None):
    """Run a scenario to its end; return what the link delivered, and the truth with every fault."""
    virtual, link = VirtualObject(scenario, seed), MemoryLink()
    link.open()
    injector = FaultInjector(virtual, link)
    host, assembler = Link(), SampleAssembler()
    session = Session(SessionSettings(), "memory:", MONOTONIC_NS)
    assembler.on_segment.append(session.new_segment)
    chunks, now_s, step, was_there = [], 0.0, 0, True
    while now_s < virtual.end_s + SETTLE_S:
        step += 1
        now_s = step * step_s
        now_ns = MONOTONIC_NS + round(now_s * 1e9)
        injector.step(now_s)
        injector.receive(now_s)
        injector.step(now_s)
        if link.connected and not was_there:
            chunks.append(Chunk(b"", now_ns))
            host.feed(chunks[-1])
            assembler.reopened()
            session.reopened(now_ns)
        was_there = link.connected
        data = link.take()
        if data:
            chunks.append(Chunk(data, now_ns))
            items = host.feed(chunks[-1])
            assembler.feed(items, now_ns)
            session.feed(items, len(data), now_ns)
        for command in session.due(now_ns):
            if link.connected:
                link.put_bytes(command)
        assert session.error is None, session.error
    return chunks, {**virtual.truth(), **injector.truth()}
