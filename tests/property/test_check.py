"""``rotdrift check``: sound is what the official reader reads without a fault, damaged is whatever was changed."""

import io
import json
import os
import struct
import zipfile
from functools import cache

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer
from zstandard import ZstdError

from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Info
from firmware_protocol.serial.framing import encode_frame
from host.errors import FileError, UsageError
from host.recording import format as fmt
from host.recording.check.mcap_file import STILL_WRITTEN_S, check_mcap
from host.recording.recovery import recover
from host.recording.writer import RecordingWriter
from host.submission.bundle import bundle_bytes
from host.submission.checked_file import check_file
from tests.command_line import rotdrift_here
from tests.damaged_files import DAMAGE, another_opcode, hole, records_of, removed, swapped, twice, write_trial
from tests.recorded_trials import MONOTONIC_NS, WALL_NS

LATER_S = 10**10
"""A clock by which nobody writes to any file any more."""
OFFICIAL_ERRORS = (
    McapError,
    ValueError,
    struct.error,
    EOFError,
    OverflowError,
    MemoryError,
    UnicodeDecodeError,
    KeyError,
    RuntimeError,  # of lz4
    ZstdError,
)


def check(path):
    return check_mcap(path, now_s=lambda: LATER_S)


def officially_sound(data):
    """Whether the official reader walks a file with all its checksums, by stream and by index."""
    try:
        for _ in StreamReader(io.BytesIO(data), validate_crcs=True, record_size_limit=2**26).records:
            pass
        reader = make_reader(io.BytesIO(data), validate_crcs=True)
        list(reader.iter_messages())
        list(reader.iter_attachments())
        list(reader.iter_metadata())
    except OFFICIAL_ERRORS:
        return False
    return True


def official_counts(data):
    """Messages by topic, as the official reader counts them."""
    topics, counts = {}, {}
    for record in StreamReader(io.BytesIO(data), validate_crcs=True).records:
        if isinstance(record, Channel):
            topics[record.id] = record.topic
            counts.setdefault(record.topic, 0)
        elif isinstance(record, Message):
            counts[topics[record.channel_id]] += 1
    return counts


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    path = tmp_path_factory.mktemp("check") / "trial.mcap"
    data = write_trial(path)
    return Trial(path, data)


class Trial:
    def __init__(self, path, data):
        self.path, self.data, self.records = path, data, records_of(data)

    def __repr__(self):  # hypothesis prints it
        return "Trial"


def test_a_recording_is_sound_and_counted_as_by_the_official_reader(trial):
    found = check(trial.path)
    assert (found.sound, found.closed, found.kind) == (True, True, "a recording of rotdrift")
    assert found.notes == ()
    assert found.checksums == {"data": "fits", "summary": "fits"}
    assert {channel.topic: channel.records for channel in found.channels} == official_counts(trial.data)
    assert all(channel.stated == channel.records for channel in found.channels)
    with trial.path.open("rb") as file:
        summary = make_reader(file).get_summary()
    span_ns = summary.statistics.message_end_time - summary.statistics.message_start_time
    assert found.span_s == span_ns / 1e9
    score = json.loads(rotdrift_here("score", trial.path, "--json").stdout)
    assert found.decoded.samples == score["losses"]["received"]
    assert found.decoded.damaged_frames == 0


@settings(max_examples=150, deadline=None)
@given(damage=DAMAGE)
def test_whatever_is_changed_in_a_closed_recording_is_found(trial, tmp_path_factory, damage):
    change, *how = damage
    data = change(trial.data, trial.records, *how)
    path = tmp_path_factory.getbasetemp() / "hurt.mcap"
    path.write_bytes(data)
    if data[:8] != trial.data[:8]:  # not even an MCAP file any more
        return
    found = check(path)
    assert found.sound == (data == trial.data), found.problems
    for line in found.lines():
        assert line.isprintable()
    json.dumps(found.to_json(), allow_nan=False)


class Foreign:
    """A file of another tool, by the official writer: chunks, attachments, metadata, indexes as asked for."""

    def __init__(self, compression, chunked, indexes, data_crc, crcs, n):
        out = io.BytesIO()
        writer = Writer(
            out, compression=compression, use_chunking=chunked, chunk_size=900, index_types=indexes,
            enable_data_crcs=data_crc, enable_crcs=crcs,
        )  # fmt: skip
        writer.start("test", "another tool")
        schema = writer.register_schema("thing", "jsonschema", b'{"type": "object"}')
        channels = [writer.register_channel(f"/{name}", "json", schema) for name in "abc"]
        writer.add_metadata("who", {"name": "somebody"})
        for number in range(n):
            writer.add_message(channels[number % 3], number * 1000, b'{"x": %d}' % number, number * 1000, number // 3)
        writer.add_attachment(5, 5, "notes.txt", "text/plain", b"hello")
        writer.finish()
        self.data = out.getvalue()
        self.records = records_of(self.data)

    def __repr__(self):
        return "Foreign"


FOREIGN = [
    (CompressionType.NONE, True, IndexType.ALL, True, True),
    (CompressionType.ZSTD, True, IndexType.ALL, False, True),
    (CompressionType.LZ4, True, IndexType.ALL, True, True),
    (CompressionType.ZSTD, True, IndexType.NONE, False, False),
    (CompressionType.NONE, False, IndexType.ALL, True, True),
    (CompressionType.NONE, True, IndexType.CHUNK, False, True),
]


@pytest.mark.parametrize("options", FOREIGN)
@pytest.mark.parametrize("n", [0, 1, 400])
def test_files_of_the_official_writer_are_sound(tmp_path, options, n):
    made = Foreign(*options, n)
    path = tmp_path / "other.mcap"
    path.write_bytes(made.data)
    found = check(path)
    assert found.problems == ()
    assert found.kind == "an MCAP file of another tool"
    counts = official_counts(made.data)
    assert {channel.topic: channel.records for channel in found.channels} == {
        topic: counts.get(topic, 0) for topic in (channel.topic for channel in found.channels)
    }
    assert sum(channel.records for channel in found.channels) == n


@settings(max_examples=150, deadline=None)
@given(options=st.sampled_from(FOREIGN), damage=DAMAGE)
def test_what_the_official_reader_refuses_is_damaged(tmp_path_factory, options, damage):
    made = foreign(options)
    change, *how = damage
    data = change(made.data, made.records, *how)
    path = tmp_path_factory.getbasetemp() / "foreign.mcap"
    path.write_bytes(data)
    if data[:8] != made.data[:8]:
        return
    found = check(path)
    if not officially_sound(data):
        assert not found.sound
    _, _, _, data_crc, crcs = options
    if data_crc and crcs:  # every byte is under a checksum
        assert found.sound == (data == made.data), found.problems


@cache
def foreign(options):
    return Foreign(*options, 60)


def problems_of(tmp_path, data):
    (tmp_path / "hurt.mcap").write_bytes(data)
    return check(tmp_path / "hurt.mcap")


def at_record(trial, number, channel=1):
    """Place and share of the n-th message of a channel."""
    chosen = [k for k, (at, _) in enumerate(trial.records) if trial.data[at] == 5 and trial.data[at + 9] == channel]
    return trial.records[chosen[number]][0], (chosen[number] + 0.5) / len(trial.records)


@pytest.mark.parametrize(
    ("change", "more", "what"),
    [
        (another_opcode, (0,), "a record of kind 0, which the format does not know"),
        (removed, (), "1 record of /raw/received is missing in front of number 101"),
        (twice, (), "a record of /raw/received has the number 100, which does not follow"),
        (swapped, (), "out of order"),
    ],
)
def test_each_problem_has_its_place_and_what_it_means(trial, tmp_path, change, more, what):
    at, share = at_record(trial, 100)
    found = problems_of(tmp_path, change(trial.data, trial.records, share, *more))
    lines = [problem.line() for problem in found.problems if what in problem.line()]
    assert lines, found.problems
    place = int(lines[0].removeprefix("at ").split(":")[0])
    assert at <= place < at + 1000
    assert lines[0].count(": ") >= 2  # place, what, meaning


def test_a_hole_of_zeros_is_one_problem_with_its_length(trial, tmp_path):
    at, _ = at_record(trial, 100)
    found = problems_of(tmp_path, hole(trial.data, trial.records, at / len(trial.data), 9 * 50))
    (zeros,) = [problem for problem in found.problems if "of kind 0" in problem.what]
    assert zeros.at == at
    assert 40 <= zeros.repeats <= 60


def test_a_flipped_bit_in_a_message_is_found_in_its_record(trial, tmp_path):
    at, _ = at_record(trial, 77)
    hurt = bytearray(trial.data)
    hurt[at + 60] ^= 4
    first = problems_of(tmp_path, bytes(hurt)).problems[0]
    assert (first.at, first.what) == (at, "a record of /raw/received is damaged (its CRC does not fit)")


def test_a_file_that_is_being_recorded_is_sound_up_to_here(trial, tmp_path):
    path = tmp_path / "live.mcap"
    path.write_bytes(trial.data[: at_record(trial, 200)[0] + 20])
    changed_s = 1_700_000_000
    os.utime(path, (changed_s, changed_s))
    live = check_mcap(path, now_s=lambda: changed_s + STILL_WRITTEN_S / 2)
    assert (live.sound, live.closed) == (True, False)
    assert "no end yet" in live.notes[0].what
    later = check_mcap(path, now_s=lambda: changed_s + 2 * STILL_WRITTEN_S)
    assert (later.sound, later.closed) == (False, False)
    assert "was killed" in later.problems[0].meaning
    assert live.decoded == later.decoded


def test_a_recovered_recording_is_sound_and_notes_what_its_source_lacked(trial, tmp_path):
    _, share = at_record(trial, 100)
    (tmp_path / "hurt.mcap").write_bytes(removed(trial.data, trial.records, share))
    recover(tmp_path / "hurt.mcap", tmp_path / "clean.mcap")
    found = check(tmp_path / "clean.mcap")
    assert found.sound
    assert [note.what for note in found.notes] == ["1 records of /raw/received are missing here"]


def test_definitions_of_another_version_are_noted(tmp_path, monkeypatch):
    topic = fmt.TOPICS[0]
    older = fmt.Topic(topic.name, topic.schema_name, topic.schema + b"# older\n")
    monkeypatch.setattr(fmt, "TOPICS", (older, *fmt.TOPICS[1:]))
    writer = RecordingWriter(tmp_path / "old.mcap", "memory:", WALL_NS, MONOTONIC_NS)
    writer.close()
    found = check(tmp_path / "old.mcap")
    assert found.sound
    assert any("definition of /raw/received" in note.what for note in found.notes)


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("t.csv", b"t,qw,qx,qy,qz\n0,1,0,0,0\n", "a CSV"),
        ("notes.txt", b"hello\n", "a text file"),
        ("a.bag", b"#ROSBAG V2.0\n" + bytes(50), "a ROS 1 bag"),
        ("a.db3", b"SQLite format 3\0" + bytes(50), "a ROS 2 bag's .db3 file"),
        ("a.parquet", b"PAR1" + bytes(50), "a parquet file"),
        ("a.blf", b"LOGG" + bytes(50), "a CAN log (BLF)"),
        ("a.bin", bytes(50), "a binary file"),
        ("wire.bin", encode_frame(encode_packet(Info(device_id=7, boot_id=1))) * 5, "bytes of a link"),
    ],
)
def test_what_is_not_a_recording_is_named(tmp_path, name, content, what):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UsageError, match="is not a recording: ") as refused:
        check_file(tmp_path / name)
    assert what in str(refused.value)
    done = rotdrift_here("check", tmp_path / name)
    assert (done.returncode, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1


def test_every_recording_of_a_submission_is_checked(trial, tmp_path):
    hurt = removed(trial.data, trial.records, 0.5)
    files = {"trials/a/raw/one.mcap": trial.data, "trials/b/raw/two.mcap": hurt, "trials/b/raw/x.csv": b"t\n1\n"}
    archive, folder = tmp_path / "submission.zip", tmp_path / "unpacked"
    archive.write_bytes(bundle_bytes(files))
    with zipfile.ZipFile(archive) as opened:
        opened.extractall(folder)
    for place in (archive, folder):
        found = check_file(place)
        assert {name: report.sound for name, report in found.items()} == {
            "trials/a/raw/one.mcap": True,
            "trials/b/raw/two.mcap": False,
        }
    done = rotdrift_here("check", archive)
    assert done.returncode == 1
    assert {"trials/a/raw/one.mcap", "trials/b/raw/two.mcap"} < set(done.stdout.splitlines())
    (folder / "trials" / "a" / "raw" / "one.mcap").write_bytes(hurt)
    with pytest.raises(FileError, match="was altered"):
        check_file(folder)


def test_exit_codes_and_json(trial, tmp_path):
    done = rotdrift_here("check", trial.path, "--json")
    values = json.loads(done.stdout)
    assert (done.returncode, values["sound"]) == (0, True)
    assert values["recordings"]["trial.mcap"]["decoded"]["samples"] > 500
    (tmp_path / "hurt.mcap").write_bytes(removed(trial.data, trial.records, 0.5))
    done = rotdrift_here("check", tmp_path / "hurt.mcap")
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].startswith("damaged: ")
    assert rotdrift_here("check", tmp_path / "nothing.mcap").returncode == 4


def test_a_chunk_that_claims_more_than_its_record_holds_is_damaged(tmp_path):
    """The library's own parser takes a shorter field for a whole one; its reader then loses its step."""
    made = foreign(FOREIGN[3])
    at = next(start for start, _ in made.records if made.data[start] == Opcode.CHUNK)
    length_at = at + 9 + 8 + 8 + 8 + 4 + 4 + len("zstd")
    (length,) = struct.unpack_from("<Q", made.data, length_at)
    hurt = made.data[:length_at] + struct.pack("<Q", length + 1) + made.data[length_at + 8 :]
    assert not officially_sound(hurt)
    (problem,) = [each for each in problems_of(tmp_path, hurt).problems if each.at == at]
    assert "a chunk is damaged" in problem.what
