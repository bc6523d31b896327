"""Every command that takes a file, given hostile bytes as that file: an exit code of ours, one sentence, no surprise.

What is drawn, and what starts processes of its own on purpose (`report`, `score` of several files), is left to
tests/integration/test_hostile_files.py: it takes seconds a file.
"""

from __future__ import annotations

import io
import os
import shutil
import tempfile
import zlib
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from host.cli import main
from tests.reader_files import named

_FOLDER = Path(tempfile.mkdtemp(prefix="rotdrift-fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))
SOUND = "sound.csv"
COMMANDS: tuple[tuple[str, ...], ...] = (
    ("score", "FILE", "--json"),
    ("score", SOUND, "--endpoints", "FILE"),
    ("score", SOUND, "--baseline", "FILE"),
    ("score", "FILE", "--columns", "t=#0,qw=#1,qx=#2,qy=#3,qz=#4"),
    ("replay", "FILE", "--json"),
    ("recover", "FILE", "out.mcap"),
    ("check", "FILE"),
    ("verify", "FILE", "--no-drawings"),
    ("compare", "FILE", "FILE.json"),
    ("baseline", "FILE"),
    ("convert", "FILE", "out.csv"),
    ("init", "cards", "--from", "FILE", "--card", "object"),
    ("emulate", "--scenario", "FILE.toml", "--link", "file:out.bin", "--duration", "0.2"),
)


def commands(data: bytes) -> None:
    """One command, chosen by the bytes themselves, with them as its file."""
    run(COMMANDS[zlib.crc32(data) % len(COMMANDS)], data)


def run(words: tuple[str, ...], data: bytes) -> int:
    """Run a command in an empty folder; return its exit code, having demanded what holds for any."""
    folder = _FOLDER / str(os.getpid())
    folder.mkdir()
    try:
        for name in {word for word in words if word.startswith("FILE")}:
            (folder / name).write_bytes(data)
        if SOUND in words:
            named(folder / SOUND, n=100)
        places = {"FILE", "FILE.json", "FILE.toml", SOUND, "out.mcap", "out.csv", "cards"}
        arguments = [str(folder / word) if word in places else word for word in words]
        arguments = [word.replace("file:out.bin", f"file:{folder}/out.bin") for word in arguments]
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as said:
            code = main(arguments)
        text = said.getvalue()
        assert code in {0, 1, 2, 3, 4}, (words, code, text)
        assert code in {0, 1} or text, (words, code)
        for line in text.splitlines():  # warnings of numpy are not for people
            assert line.startswith("rotdrift: "), (words, text)
            assert line.isprintable(), (words, text)
        return code
    finally:
        shutil.rmtree(folder)
