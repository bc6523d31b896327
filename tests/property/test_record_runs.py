"""Runs of message records against walking them one by one, with payloads full of what looks like records."""

import random
import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.large_recordings import write_large
from host.recording.bulk.record_runs import MESSAGE_HEAD_BYTES, EvenRun, RecordRuns
from host.recording.load import load_trial


def record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


def walked(block: bytes, last_channel: int = 2**16 - 1) -> list[tuple[int, int, int]]:
    """Whole messages by the definition: start, end, channel; None for the others, and for channels not known."""
    found = []
    offset = 0
    while len(block) - offset >= 9:
        kind, length = struct.unpack_from("<BQ", block, offset)
        end = offset + 9 + length
        if end > len(block):
            break
        channel = struct.unpack_from("<H", block, offset + 9)[0] if kind == 5 and length >= MESSAGE_HEAD_BYTES else None
        found.append((offset, end, None if channel is None or channel > last_channel else channel))
        offset = end
    return found


def by_runs(block: bytes, last_channel: int = 2**16 - 1) -> list[tuple[int, int, int]]:
    runs = RecordRuns(memoryview(block), [1, last_channel])
    found = []
    offset = 0
    while len(block) - offset >= 9:
        run = runs.at(offset)
        if run is None:
            _, length = struct.unpack_from("<BQ", block, offset)
            if offset + 9 + length > len(block):
                break
            found.append((offset, offset + 9 + length, None))
        else:
            whole = run.whole() if isinstance(run, EvenRun) else run
            found += [(start, end, channel) for channel, start, end in whole.places()]
            assert found[-1][1] == run.end
        offset = found[-1][1]
    return found


@given(
    seed=st.integers(0, 2**32), n=st.integers(0, 60), cut=st.integers(0, 200), last=st.sampled_from([2**16 - 1, 300, 1])
)
@settings(derandomize=True, deadline=None, max_examples=200)
def test_runs_are_the_records_that_walking_finds(seed, n, cut, last):
    rng = random.Random(seed)
    parts = []
    for _ in range(n):
        look_alike = record(5, bytes(rng.randrange(20, 40))) * rng.randrange(4)
        payload = rng.randbytes(rng.randrange(5)) + look_alike + rng.choice([b"\x05", b"\0", b"\x05\0\0\0"]) * 9
        head = struct.pack("<HIQQ", rng.randrange(1, 400), 5, 5, 2**40)
        kind = rng.choice([5, 5, 5, 5, 4, 3, 12])
        parts.append(record(kind, rng.choice([head + payload, head, payload[:21], b""])))
    block = b"".join(parts)
    block = block[: max(len(block) - cut, 0)]
    assert by_runs(block, last) == walked(block, last)


def test_records_without_a_body_by_the_thousand_are_left_to_the_walk():
    message = record(5, struct.pack("<HIQQ", 1, 0, 0, 0))
    block = message + record(6, b"") * 30_000 + message * 700
    found = by_runs(block)
    assert [place[:2] for place in found] == [place[:2] for place in walked(block)]
    assert sum(channel == 1 for _, _, channel in found) > 500  # in the lanes behind them


def test_a_message_of_many_megabytes_is_left_to_the_walk():
    block = record(5, bytes(2**24 + 5)) + record(5, bytes(30))
    assert by_runs(block) == [(0, len(block) - 39, None), (len(block) - 39, len(block), 0)]


@given(seed=st.integers(0, 2**32), beat=st.integers(1, 70), n=st.integers(0, 3000), cut=st.integers(0, 90))
@settings(derandomize=True, deadline=None, max_examples=40)
def test_records_that_come_evenly_are_found_up_to_where_they_do_not(seed, beat, n, cut):
    rng = random.Random(seed)
    sizes = [rng.randrange(30) for _ in range(beat)]
    parts = []
    for k in range(n):
        head = struct.pack("<HIQQ", 1 + k % beat % 3, k, 5, 2**40)
        parts.append(record(5, head + rng.randbytes(sizes[k % beat])))
    for _ in range(rng.randrange(3) if n else 0):
        parts[rng.randrange(n)] = rng.choice([b"", record(5, bytes(23)), record(4, b"x"), record(5, b"short")])
    block = b"".join(parts)
    block = block[: max(len(block) - cut, 0)]
    assert by_runs(block) == walked(block)


def test_the_large_recordings_of_the_benchmarks_are_recordings(tmp_path):
    path = tmp_path / "large.mcap"
    assert write_large(path, 3000) == path.stat().st_size
    trial = load_trial(path)
    assert trial.damage == ()
    assert len(trial.series) == trial.losses.produced == 3000
