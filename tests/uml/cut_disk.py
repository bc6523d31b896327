"""What a power cut leaves: the disk at every moment at which it may come, and what had been received by then."""

from __future__ import annotations

import itertools
import random
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from host.links.transport import Chunk
from host.recording.reader import RecordingReader
from tests.uml.boot import boot
from tests.uml.volatile_disk import Batch, batches
from tests.waiting import HANG_S

DISK_BYTES, JOURNAL_BYTES, LOG_BYTES = 16 << 20, 128 << 20, 16 << 20
LIMIT_S = 480
PROGRAMS = ("mkfs.ext4", "e2fsck", "debugfs")
"""Of e2fsprogs: they make the file system, repair it from its own journal, and read a file of it."""
PATH = {"PATH": "/usr/sbin:/sbin:/usr/bin:/bin"}


@dataclass(frozen=True)
class Cut:
    """Power fails at a moment."""

    received: list[Chunk]
    """What the link had delivered by then; times of the log of the link."""
    recording: Path | None
    """The file as the disk has it, after the file system was repaired; None where there is none yet."""
    certain: int
    """Bytes that must be in it: the program had been told that they are on the disk."""

    @property
    def lost_s(self) -> float:
        """Time from the first chunk that is not in the recording to the last that was received, s."""
        lost = [chunk.host_time_ns for chunk in self.received[len(self.kept) :]]
        return (lost[-1] - lost[0]) / 1e9 if lost else 0.0

    @property
    def kept(self) -> list[Chunk]:
        """What was received and is in the recording."""
        n = sum(len(chunk.data) for chunk in self.recorded)
        ends = itertools.accumulate(len(chunk.data) for chunk in self.received)
        return [chunk for chunk, end in zip(self.received, ends, strict=True) if end <= n]

    @property
    def recorded(self) -> list[Chunk]:
        """What is in the recording."""
        return [] if self.recording is None else list(RecordingReader(self.recording).chunks())


class CutDisk:
    """A capture that ran in the user-mode kernel, and its disk at any moment."""

    def __init__(self, work: Path) -> None:
        self._work = work
        self.printed = ""
        self.batches: list[Batch] = []
        self._log = b""

    def run(self, capture_s: float, limit_s: float = LIMIT_S) -> None:
        """Capture for so long; afterwards, what has lasted and what was received are known."""
        disk, journal, log = (self._work / name for name in ("disk", "journal", "log"))
        for path, size in ((disk, DISK_BYTES), (journal, JOURNAL_BYTES), (log, LOG_BYTES)):
            with path.open("wb") as file:
                file.truncate(size)
        _run("mkfs.ext4", "-F", "-q", "-b", "4096", "-m", "0", str(disk))
        disks = (f"ubd0={disk}", f"ubd1={journal}", f"ubd2={log}")
        self.printed = boot("tests.uml.power_cut", self._work, limit_s, *disks, f"POWER_CUT_S={capture_s}")
        self.batches = list(batches(journal))
        self._log = log.read_bytes().partition(b"\n# END\n")[0] + b"\n"

    def cuts(self, seed: int | None = None, every: int = 1) -> Iterator[Cut]:
        """Yield a cut just before each batch of writes has lasted: the moment at which the most is lost.

        With a seed, some of that batch have lasted all the same, in any order, as a disk without power may leave it.
        Of several cuts one is yielded, and the last: the program has ended.
        """
        rng = random.Random(seed)
        image = bytearray((self._work / "disk").read_bytes())
        for number, batch in enumerate(self.batches):
            torn = bytearray(image)
            if seed is not None:
                for at, data in rng.sample(batch.writes, rng.randint(0, len(batch.writes))):
                    torn[at : at + len(data)] = data
            if number % every == 0:
                yield self._cut(torn, batch.received, batch.synced)
            for at, data in batch.writes:
                image[at : at + len(data)] = data
        yield self._cut(image, len(self._log), self.batches[-1].synced)

    def _cut(self, image: bytearray, log_bytes: int, certain: int) -> Cut:
        return Cut(self._received(log_bytes), self._recording(image), certain)

    def _received(self, log_bytes: int) -> list[Chunk]:
        lines = self._log[:log_bytes].rpartition(b"\n")[0].decode().splitlines()
        reads = [line.split() for line in lines if not line.startswith("#")]
        return [Chunk(bytes.fromhex("".join(r[3:])), round(float(r[0]) * 1e9)) for r in reads if r[1:2] == ["<"]]

    def _recording(self, image: bytearray) -> Path | None:
        disk, recording = self._work / "cut", self._work / "cut.mcap"
        disk.write_bytes(image)
        recording.unlink(missing_ok=True)
        _run("e2fsck", "-fy", str(disk), codes=(0, 1))
        _run("debugfs", "-R", f"dump /trial.mcap {recording}", str(disk))
        return recording if recording.exists() else None


def _run(*words: str, codes: tuple[int, ...] = (0,)) -> None:
    done = subprocess.run(words, env=PATH, capture_output=True, text=True, timeout=HANG_S, check=False)
    assert done.returncode in codes, (words, done.stdout, done.stderr)
