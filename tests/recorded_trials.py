"""Recordings for tests, made by the emulator in virtual time through the real wire."""

from dataclasses import replace

from emulator.scenario import load_scenario
from emulator.virtual_object import VirtualObject
from firmware_protocol.packets import GetInfo, Start
from host.links.transport import Chunk
from host.recording.writer import RecordingWriter
from tests.memory_link import MemoryLink

WALL_NS = 1_760_000_000_000_000_000
MONOTONIC_NS = 9_000_000_000_000


def scenario(name="ideal", **tables):
    """A shipped scenario with some keys replaced: ``motion={"cycles": 5}``."""
    found = load_scenario(name)
    return replace(found, **{table: replace(getattr(found, table), **keys) for table, keys in tables.items()})


def virtual_chunks(chosen, chunk_s=0.01, seed=None, duration_s=None):
    """Run a virtual object to its end; return what its link delivered, and the truth."""
    virtual, link = VirtualObject(chosen, seed), MemoryLink()
    link.open()
    link.put(GetInfo(1), Start(2))
    chunks, now_s, step = [], 0.0, 0
    while now_s < (virtual.end_s if duration_s is None else duration_s):
        step += 1
        now_s = step * chunk_s
        for command in link.receive():
            virtual.firmware.receive(command, now_s)
        virtual.firmware.step(now_s, link.send)
        data = link.take()
        if data:
            chunks.append(Chunk(data, MONOTONIC_NS + round(now_s * 1e9)))
    return chunks, virtual.truth()


def write_recording(path, chunks, close=True):
    """Write chunks as a capture does."""
    writer = RecordingWriter(path, "memory:", WALL_NS, MONOTONIC_NS)
    for chunk in chunks:
        writer.add_received(chunk)
    if close:
        writer.close()
    else:
        writer.flush_if_due(chunks[-1].host_time_ns + 10**9)
    return path
