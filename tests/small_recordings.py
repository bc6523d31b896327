"""A few chunks, and a writer for them."""

from host.links.transport import Chunk
from host.recording.writer import RecordingWriter

WALL = 1_760_000_000_000_000_000
MONO = 5_000_000_000_000


def writer(path):
    return RecordingWriter(path, "serial:/dev/ttyACM0", WALL, MONO, {"cycles": 10})


def chunks(n=20):
    return [Chunk(bytes(range(i % 256)) + b"\x00", MONO + i * 1_000_000) for i in range(n)]
