"""Small files that claim, or unpack to, more than memory: a right result or one sentence, within 1 GiB, in time."""

from __future__ import annotations

import json
import sys

import pytest

from analysis.confined import limits
from analysis.formats import ReaderError, read_series
from tests import hostile_files as made
from tests.limited_run import limited_runs
from tests.waiting import SLOW_S

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="RLIMIT_AS and fork are Linux's")

SCORED = ("score", "FILE", "--json")
MIB = 2**20
IN_PROCESS_BYTES = 320 * MIB
"""Nothing that a hostile file makes the process itself hold is near this; what it imports takes 90 to 250 MiB."""
WORDS = {
    made.gz: "is packed",
    made.zst: "is packed",
    made.zst_claim: "is packed",
    made.ros2_mcap_of_zstd: "at most 268435456 are read",
    made.ros2_mcap_of_lz4: "at most 268435456 are read",
    made.ros1_chunk_of_bz2: "of memory",
    made.ros1_chunk_of_lz4: "of memory",
    made.ros2_blob_that_is_computed: "too big",
    made.parquet_of_one_value: "of memory",
    made.parquet_that_claims_rows: "more than 20 million samples",
    made.blf_container: "of memory",
    made.csv_times_of_no_size: "in the right unit?",
    made.csv_counters_of_2_to_the_63: "in the right unit?",
    made.host_times_a_century_apart: "was the clock set there?",
    made.host_times_years_apart: "is the unit of time right?",
    made.host_times_at_the_end_of_time: "was the clock set there?",
    made.csv_times_a_century_apart: "was the clock set there?",
    made.tum_times_a_century_apart: "is the unit of time right?",
    made.mcap_chunk_claims_4_gib: "a chunk is damaged (too large)",
    made.mcap_chunk_of_zstd: "a chunk is damaged",
    made.mcap_chunk_of_lz4: "a chunk is damaged",
}
"""What `score` has to say; of the others, anything that is true of every answer."""
CASES = [
    *((kind, SCORED) for kind in made.TRIALS),
    *(
        (kind, words)
        for kind in (made.host_times_years_apart, made.tum_times_a_century_apart)
        for words in (("baseline", "FILE"), ("convert", "FILE", "OUT", "--to", "ros2"))
    ),
    (made.host_times_years_apart, ("score", "FILE", "--endpoints", "9,99,999,1100", "--plot", "OUT.png")),
    (made.host_times_years_apart, ("replay", "FILE", "--json")),
    (made.ros2_mcap_of_lz4, ("check", "FILE")),
    (made.mcap_chunk_of_zstd, ("recover", "FILE", "OUT.mcap")),
    (made.zip_of_zeros, ("verify", "FILE")),
    (made.zip_of_zeros, ("compare", "FILE")),
    (made.nested_json, ("compare", "FILE")),
    (made.json_of_many_lists, ("compare", "FILE")),
]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Every case, run in one go; the files are small, and gone behind it."""
    lines, places = [], {}
    for number, (kind, words) in enumerate(CASES):
        if kind not in places:
            places[kind] = kind(tmp_path_factory.mktemp(kind.__name__))
        out = places[kind].parent / f"out{number}"
        lines.append([word.replace("FILE", str(places[kind])).replace("OUT", str(out)) for word in words])
    return dict(zip(CASES, limited_runs(lines), strict=True))


@pytest.mark.parametrize(("kind", "words"), CASES, ids=[f"{words[0]}-{kind.__name__}" for kind, words in CASES])
def test_a_result_or_one_sentence_in_memory_and_time(runs, kind, words):
    run = runs[kind, words]
    assert run.code in {0, 1, 2, 4}, run
    said = run.out
    if "--json" in words and run.out:  # of several sessions, even where none has a result
        assert isinstance(json.loads(run.out), dict)
    elif run.code and words[0] != "check":  # whose findings are its output
        said = run.err
        assert said.startswith("rotdrift: ")
        assert said.count("\n") == 1
        assert len(said) < 600
    if words == SCORED:
        assert WORDS.get(kind, "") in said
    unpacks_elsewhere = "of memory" in WORDS.get(kind, "") or kind in {made.mcap_chunk_of_lz4, made.mcap_chunk_of_zstd}
    assert run.peak_bytes < (2**30 if unpacks_elsewhere else IN_PROCESS_BYTES), run
    assert run.cpu_s < SLOW_S, run


def test_a_bag_that_unpacks_to_the_disk_stops_at_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "MAX_OUTPUT_BYTES", 20 * MIB)
    with pytest.raises(ReaderError, match="more than 20 MiB come out of it"):
        read_series(made.ros2_packed_file(tmp_path))
