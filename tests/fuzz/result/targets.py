"""What each target makes of a random number generator: an input, and all that happens to it."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

from firmware_protocol.serial.framing import encode_frame
from host.links.transport import Chunk
from tests.fuzz.result import frames
from tests.fuzz.result.members import submission
from tests.fuzz.result.packets import mutated, serial_chunks
from tests.fuzz.result.recorded import recording
from tests.fuzz.result.road import follow


def serial(rng: Random) -> str:
    """A session on a serial line, packet by packet odd, to the result."""
    session, line = mutated(rng)
    chunks, n_frames = serial_chunks(line, rng)
    commands = [Chunk(encode_frame(packet), time_ns) for time_ns, packet in session.commands]
    return follow(chunks, commands, n_frames=n_frames)


def can(rng: Random) -> str:
    """A session on a CAN bus, frame by frame odd, to the result; followed by node id, or the first that is heard."""
    session, line = frames.mutated(rng)
    chunks = frames.can_chunks(line, rng)
    commands = [Chunk(packet, time_ns) for time_ns, packet in session.commands]
    return follow(chunks, commands, rng.choice((None, frames.NODE)))


TARGETS: dict[str, Callable[[Random], str]] = {
    "serial": serial,
    "can": can,
    "recording": recording,
    "submission": submission,
}
"""Name -> what makes an input, sends it on its way, and returns in a word what became of it."""
