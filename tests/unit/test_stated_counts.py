"""What a closed recording states of itself is relied on only where it can be read, even under a right checksum."""

import struct
import zlib

import pytest
from mcap.opcode import Opcode

from host.recording.completeness import stated_counts
from host.recording.recovery import recover
from tests.recorded_trials import scenario, virtual_chunks, write_recording

FRAME = struct.Struct("<BQ")
FOOTER_BYTES = FRAME.size + 20
MAGIC_BYTES = 8


@pytest.fixture(scope="module")
def closed(tmp_path_factory):
    chunks, _ = virtual_chunks(scenario("static"), duration_s=1.0)
    return write_recording(tmp_path_factory.mktemp("closed") / "trial.mcap", chunks).read_bytes()


def with_statistics(data, change):
    """Return a recording with the body of its statistics changed, and the summary's checksum put right."""
    footer_at = len(data) - MAGIC_BYTES - FOOTER_BYTES
    summary_at, offsets_at, _ = struct.unpack_from("<QQI", data, footer_at + FRAME.size)
    out, at = b"", summary_at
    while at < footer_at:
        kind, length = FRAME.unpack_from(data, at)
        body = data[at + FRAME.size : at + FRAME.size + length]
        if kind == Opcode.STATISTICS:
            body = change(body)
        out += FRAME.pack(kind, len(body)) + body
        at += FRAME.size + length
    out += FRAME.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", summary_at, 0 if offsets_at else offsets_at)
    return data[:summary_at] + out + struct.pack("<I", zlib.crc32(out)) + data[-MAGIC_BYTES:]


def test_the_counts_of_a_sound_file_are_read(tmp_path, closed):
    path = tmp_path / "trial.mcap"
    path.write_bytes(with_statistics(closed, lambda body: body))
    assert stated_counts(path)


@pytest.mark.parametrize("n", [0, 1, 20, 43, -1, -3])
def test_statistics_that_end_too_early_count_nothing(tmp_path, closed, n):
    path = tmp_path / "trial.mcap"
    path.write_bytes(with_statistics(closed, lambda body: body[:n]))
    assert stated_counts(path) == {}
    assert recover(path, tmp_path / "clean.mcap").chunks > 0
