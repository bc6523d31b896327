"""Recovery of hostile files: work in proportion to their bytes, counted, and nothing lost for it."""

import random
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.recovery import metadata, random_pattern, raw_heads, repeated, worst_patterns
from host.links.transport import MAX_CHUNK_BYTES, Chunk
from host.recording import format as fmt
from host.recording import recovery
from host.recording.bulk.span_checksums import span_checksums
from host.recording.recovery import salvage
from host.recording.writer import RecordingWriter
from tests.recorded_trials import MONOTONIC_NS, WALL_NS

MOST_TIMES = 8
"""A block is passed over five times at most, three for raw messages and one for each other kind, an eighth of it with
the block before as well; and a whole message is checked again when it is read, as received and as sent."""


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32), n=st.integers(0, 200))
def test_checksums_of_overlapping_spans_are_those_of_zlib(seed, n):
    rng = np.random.default_rng(seed)
    data = rng.bytes(3000)
    starts, ends = np.sort(rng.integers(0, len(data) + 1, (2, n)), axis=0)
    seeds = rng.integers(0, 2**32, n, dtype=np.uint32)
    expected = [zlib.crc32(data[a:b], seed) for a, b, seed in zip(starts, ends, seeds.tolist(), strict=True)]
    assert span_checksums(memoryview(data), starts, ends, seeds).tolist() == expected


@pytest.fixture
def checksummed(monkeypatch):
    """How many bytes were checksummed, or parsed as a description."""
    counted, crc32, parse_header = [0], zlib.crc32, recovery.parse_header

    def counting(data, value=0):
        counted[0] += len(data)
        return crc32(data, value)

    def counting_parse(body):
        counted[0] += len(body)
        return parse_header(body)

    monkeypatch.setattr(zlib, "crc32", counting)
    monkeypatch.setattr(recovery, "parse_header", counting_parse)
    return counted


PATTERNS = worst_patterns() | {f"random {seed}": random_pattern(random.Random(seed)) for seed in range(20)}


@pytest.mark.parametrize("name", PATTERNS)
def test_the_work_for_hostile_files_is_in_proportion_to_their_bytes(name, tmp_path, checksummed):
    path = tmp_path / "worst.mcap"
    path.write_bytes(repeated(PATTERNS[name], 300_000))
    _, messages = salvage(path)
    assert checksummed[0] <= 65536 * recovery.MAX_HEADER_TRIES  # the description: a limit for files of any size
    checksummed[0] = 0
    for _ in messages:
        pass
    assert checksummed[0] <= MOST_TIMES * 300_000


def test_false_descriptions_are_tried_a_bounded_number_of_times(tmp_path, checksummed):
    path = tmp_path / "worst.mcap"
    path.write_bytes(repeated(metadata(65_000), 10_000_000))
    header, messages = salvage(path)
    assert (header, list(messages)) == (None, [])
    assert 0 < checksummed[0] <= 65536 * recovery.MAX_HEADER_TRIES + MOST_TIMES * 10_000_000


def test_records_among_hostile_bytes_are_found_wherever_blocks_of_the_search_end(tmp_path, monkeypatch):
    longest = Chunk(bytes(2 * MAX_CHUNK_BYTES), MONOTONIC_NS)
    writer = RecordingWriter(tmp_path / "whole.mcap", "memory:", WALL_NS, MONOTONIC_NS)
    for number in range(40):
        writer.add_received(Chunk(bytes([number]) * number, MONOTONIC_NS + number))
        writer.add_sent(b"command", MONOTONIC_NS + number)
        writer.add_values(fmt.ACTION, {"kind": "marker", "text": f"{number}"}, MONOTONIC_NS + number)
    writer.add_received(longest)
    writer.close()
    hostile = repeated(raw_heads(8, 2 * MAX_CHUNK_BYTES), 5000)
    path = tmp_path / "hostile.mcap"
    path.write_bytes(hostile + (tmp_path / "whole.mcap").read_bytes() + hostile)
    _, messages = salvage(path)
    expected = list(map(repr, messages))  # NaN is not equal to itself
    assert len(expected) == 3 * 40 + 1
    assert sum(repr(longest) in text for text in expected) == 1
    for block_bytes in (997, 4096, 31_000):
        monkeypatch.setattr(recovery, "SEARCH_BLOCK_BYTES", block_bytes)
        assert list(map(repr, salvage(path)[1])) == expected
