"""Recordings that another tool has packed into compressed chunks: unpacked elsewhere, read as they were."""

from __future__ import annotations

import struct
import zlib

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

import host.recording.bulk.compressed_chunks as chunks_module
from analysis.confined.call import StoppedError
from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from tests.hostile_files import record
from tests.small_recordings import chunks, writer

PACKERS = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}
IN_CHUNKS = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE}


def packed(path, kinds, spoil=()):
    """Write a recording again: its messages in chunks of three, each of the next kind; some damaged."""
    source = path.with_suffix(".source.mcap")
    with_chunks = writer(source)
    for chunk in chunks(30):
        with_chunks.add_received(chunk)
    with_chunks.close()
    data, at, front, pieces = source.read_bytes(), len(MCAP0_MAGIC), b"", []
    while data[at] not in {Opcode.DATA_END, Opcode.FOOTER}:
        end = at + 9 + struct.unpack_from("<Q", data, at + 1)[0]
        if data[at] in IN_CHUNKS:
            pieces.append(data[at:end])
        else:
            front += data[at:end]
        at = end
    described = [piece for piece in pieces if piece[0] != Opcode.MESSAGE]
    messages = [piece for piece in pieces if piece[0] == Opcode.MESSAGE]
    groups = [b"".join(described), *(b"".join(messages[k : k + 3]) for k in range(0, len(messages), 3))]
    body = b""
    for number, group in enumerate(groups):
        kind = kinds[number % len(kinds)]
        content = bytearray(PACKERS[kind](group))
        if number in spoil:
            content[len(content) // 2] ^= 0xFF
        name = kind.encode()
        head = struct.pack("<QQQII", 0, 0, len(group), zlib.crc32(group), len(name)) + name
        body += record(Opcode.CHUNK, head + struct.pack("<Q", len(content)) + bytes(content))
    path.write_bytes(MCAP0_MAGIC + front + body)
    return path


@pytest.mark.parametrize("kinds", [["zstd"], ["lz4"], ["", "zstd", "lz4", ""]])
def test_every_chunk_is_read_as_it_was(tmp_path, kinds):
    reader = RecordingReader(packed(tmp_path / "a.mcap", kinds))
    assert list(reader.chunks()) == chunks(30)
    assert list(reader.chunks()) == chunks(30)  # and again
    assert [words for words in reader.damage if "chunk" in words] == []


@pytest.mark.parametrize("kinds", [["zstd"], ["", "lz4"]])
def test_a_damaged_chunk_is_left_out_and_no_other(tmp_path, kinds):
    reader = RecordingReader(packed(tmp_path / "a.mcap", kinds, spoil={3, 6}))
    assert list(reader.chunks()) == [chunk for k, chunk in enumerate(chunks(30)) if k // 3 not in {2, 5}]
    assert sum("a chunk is damaged" in words for words in reader.damage) == 2


def test_where_the_process_is_stopped_the_rest_is_damaged(tmp_path, monkeypatch):
    path = packed(tmp_path / "a.mcap", ["zstd"])

    def stopped(*arguments, limits):
        real = chunks_module.contents(str(path))
        yield from (bytearray(next(real)) for _ in range(4))
        raise StoppedError("reading it did not end within 20 s")

    monkeypatch.setattr(chunks_module, "pieces_of", stopped)
    trial = load_trial(path)
    assert sum("a chunk is damaged" in words for words in trial.damage) == 7
    assert "a chunk is damaged (reading it did not end within 20 s) and left out" in trial.damage
