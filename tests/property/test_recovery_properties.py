"""Damaged recordings: whatever byte is hit, all outside the damaged record survives, and nothing else appears."""

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from host.errors import FileError
from host.links.transport import Chunk, FrameChunk
from host.recording import format as fmt
from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from host.recording.recovery import recover
from host.recording.writer import RecordingWriter
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario, virtual_chunks

RECORD = struct.Struct("<BQ")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording with everything in it: its bytes, and where each raw record stands."""
    path = tmp_path_factory.mktemp("whole") / "trial.mcap"
    chunks, _ = virtual_chunks(scenario("ideal"), duration_s=0.6)
    writer = RecordingWriter(path, "serial:/dev/x", WALL_NS, MONOTONIC_NS, {"cycles": 7})
    for number, chunk in enumerate(chunks):
        writer.add_received(chunk)
        if number % 10 == 0:
            writer.add_sent(b"\0command\0", chunk.host_time_ns)
            writer.add_note("warning", f"note {number}", chunk.host_time_ns)
            writer.add_values(fmt.ACTION, {"kind": "marker", "text": f"marker {number}"}, chunk.host_time_ns)
        if number == 30:
            writer.add_received(Chunk(b"", chunk.host_time_ns))
    writer.add_received(FrameChunk(b"CF packed \x00\x01\x00\x00", chunks[-1].host_time_ns))
    writer.close()
    data = path.read_bytes()
    return data, raw_records(data), path


def raw_records(data):
    """Where the raw records stand, by walking the file as the format says: (start, end, topic, chunk)."""
    topics = {number: topic.name for number, topic in enumerate(fmt.TOPICS, start=1)}
    found, at = [], 8
    while at + RECORD.size <= len(data):
        kind, length = RECORD.unpack_from(data, at)
        end = at + RECORD.size + length
        if kind == 5:
            topic = topics[struct.unpack_from("<H", data, at + 9)[0]]
            if topic in (fmt.RECEIVED, fmt.SENT):
                found.append((at, end, topic, fmt.decode_raw(data[at + 31 : end], topic)))
        if kind == 15:  # the data ends here; what follows is an index
            break
        at = end
    return found


def recovered(folder, data):
    """The raw chunks that recovery finds in some bytes; None if it finds nothing."""
    source, target = folder / "hurt.mcap", folder / "clean.mcap"
    source.write_bytes(data)
    target.unlink(missing_ok=True)
    try:
        report = recover(source, target)
    except FileError:  # nothing whole in it, which the caller's own list of records tells as well
        return None, {fmt.RECEIVED: [], fmt.SENT: []}
    reader = RecordingReader(target)
    chunks = {}
    for topic, missing in ((fmt.RECEIVED, report.missing_chunks), (fmt.SENT, report.missing_others)):
        chunks[topic] = list(reader.chunks(topic))
        assert len(reader.damage) <= min(missing, 1)  # what was missing from the source, and nothing else
        assert all("recovered from" in sentence for sentence in reader.damage)
    return report, chunks


def expected(records, is_hit):
    return {
        topic: [chunk for start, end, name, chunk in records if name == topic and not is_hit(start, end)]
        for topic in (fmt.RECEIVED, fmt.SENT)
    }


def contains(longer, shorter):
    """Whether ``shorter`` is what is left of ``longer`` when some are taken out."""
    rest = iter(longer)
    return all(item in rest for item in shorter)


@settings(max_examples=400, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1, max_size=8))
def test_flipped_bytes_cost_the_records_they_hit_and_nothing_else(whole, tmp_path_factory, flips):
    data, records, _ = whole
    hurt = bytearray(data)
    hits = set()
    for share, bits in flips:
        at = int(share * len(data))
        hurt[at] ^= bits
        hits |= {at} if hurt[at] != data[at] else set()
    _, found = recovered(tmp_path_factory.getbasetemp(), bytes(hurt))
    for topic, chunks in expected(records, lambda start, end: any(start <= at < end for at in hits)).items():
        everything = [chunk for _, _, name, chunk in records if name == topic]
        assert contains(found[topic], chunks)  # all that was not hit is there
        assert contains(everything, found[topic])  # nothing that was never written is there


@settings(max_examples=150, deadline=None)
@given(st.floats(0, 1), st.integers(0, 3000))
def test_a_piece_cut_out_costs_what_stood_in_it(whole, tmp_path_factory, share, length):
    data, records, _ = whole
    at = int(share * len(data))
    _, found = recovered(tmp_path_factory.getbasetemp(), data[:at] + data[at + length :])
    survivors = expected(records, lambda start, end: start < at + max(length, 1) and end > at)
    for topic, chunks in survivors.items():
        assert contains(found[topic], chunks)
        assert contains([chunk for _, _, name, chunk in records if name == topic], found[topic])


@settings(max_examples=150, deadline=None)
@given(st.floats(0, 1))
def test_a_cut_file_keeps_everything_before_the_cut(whole, tmp_path_factory, share):
    data, records, _ = whole
    at = int(share * len(data))
    _, found = recovered(tmp_path_factory.getbasetemp(), data[:at])
    assert found == expected(records, lambda _start, end: end > at)


def test_an_undamaged_recording_comes_out_the_same(whole, tmp_path):
    data, records, path = whole
    report, found = recovered(tmp_path, data)
    assert found == expected(records, lambda _start, _end: False)
    assert (report.missing_chunks, report.missing_others, report.header_found) == (0, 0, True)
    clean = tmp_path / "clean.mcap"
    assert RecordingReader(clean).header == RecordingReader(path).header
    kept = {fmt.ACTION: [], fmt.NOTE: []}
    for message in RecordingReader(path).messages(kept):
        kept[message.topic].append(message.values())
    again = {fmt.ACTION: [], fmt.NOTE: []}
    for message in RecordingReader(clean).messages(again):
        again[message.topic].append(message.values())
    assert repr(again[fmt.ACTION]) == repr(kept[fmt.ACTION])  # NaN is not equal to itself
    assert len(again[fmt.ACTION]) == 6
    assert [note["text"] for note in again[fmt.NOTE][:-1]] == [note["text"] for note in kept[fmt.NOTE]]
    assert again[fmt.NOTE][-1]["kind"] == "recovered"


def test_what_is_missing_is_counted_and_the_samples_are_in_the_ledger(tmp_path):
    chunks, _ = virtual_chunks(scenario("ideal", motion={"cycles": 5}))
    path = tmp_path / "trial.mcap"
    writer = RecordingWriter(path, "memory:", WALL_NS, MONOTONIC_NS)
    for chunk in chunks:
        writer.add_received(chunk)
    writer.close()
    hurt = bytearray(path.read_bytes())
    records = raw_records(bytes(hurt))
    for number in (700, 701, 702, 1500):
        start, end, _, _ = records[number]
        hurt[start + 4] ^= 0x55  # the length: whoever walks the records is lost from here
        hurt[end - 3] ^= 0x01
    path.write_bytes(hurt)
    assert load_trial(path).damage
    report = recover(path, tmp_path / "clean.mcap")
    assert report.chunks == len(chunks) - 4
    assert report.missing_chunks == 4
    assert_four_are_missing(load_trial(tmp_path / "clean.mcap"))
    recover(tmp_path / "clean.mcap", tmp_path / "cleaner.mcap")
    assert_four_are_missing(load_trial(tmp_path / "cleaner.mcap"))


def assert_four_are_missing(trial):
    assert trial.damage == (
        "4 records of /raw/received are missing from the file that this one was recovered from: damaged there, not "
        "lost on the link",
    )
    assert (trial.losses.missing, trial.losses.damaged_in_file, trial.losses.lost) == (4, 4, 0)
    assert trial.losses.received == trial.losses.produced - 4


def test_a_capture_killed_before_its_first_flush_leaves_a_recording_of_nothing(tmp_path):
    writer = RecordingWriter(tmp_path / "killed.mcap", "serial:/dev/ttyACM0", WALL_NS, 10**9)
    (tmp_path / "cut.mcap").write_bytes((tmp_path / "killed.mcap").read_bytes())
    writer.close()
    report = recover(tmp_path / "cut.mcap", tmp_path / "clean.mcap")
    assert (report.chunks, report.missing_chunks, report.header_found) == (0, 0, True)
    clean = RecordingReader(tmp_path / "clean.mcap")
    assert list(clean.chunks()) == []
    assert clean.damage == []
    assert clean.header.link == "serial:/dev/ttyACM0"


def test_what_never_was_a_recording_and_what_exists_are_refused(tmp_path):
    (tmp_path / "text.mcap").write_bytes(b"hello" * 1000)
    with pytest.raises(FileError, match="holds no whole record"):
        recover(tmp_path / "text.mcap", tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()
    with pytest.raises(FileError, match="there is no file"):
        recover(tmp_path / "nothing.mcap", tmp_path / "out.mcap")


def test_an_existing_file_is_not_written_over(whole, tmp_path):
    _, _, path = whole
    (tmp_path / "mine.mcap").write_text("mine")
    with pytest.raises(FileError, match="exists already"):
        recover(path, tmp_path / "mine.mcap")
    assert (tmp_path / "mine.mcap").read_text() == "mine"


def test_a_flipped_channel_does_not_make_a_command_of_data(whole, tmp_path):
    data, records, _ = whole
    start, *_ = next(record for record in records if record[2] == fmt.RECEIVED)
    hurt = bytearray(data)
    hurt[start + 9] = 2  # the channel of what was sent
    path = tmp_path / "hurt.mcap"
    path.write_bytes(hurt)
    reader = RecordingReader(path)
    list(reader.chunks(fmt.SENT))
    assert any("another channel" in sentence for sentence in reader.damage)
    _, found = recovered(tmp_path, bytes(hurt))
    assert found == expected(records, lambda _start, _end: False)


def test_a_damaged_description_is_not_believed(whole, tmp_path):
    data, _, path = whole
    at = data.index(b"serial:/dev/x")
    hurt = bytearray(data.replace(b"serial:/dev/x", b"serial:/dev/y"))
    assert hurt[at:] != data[at:]
    (tmp_path / "hurt.mcap").write_bytes(hurt)
    reader = RecordingReader(tmp_path / "hurt.mcap")
    assert reader.header.link == ""
    assert list(reader.chunks()) == list(RecordingReader(path).chunks())
    assert "description is damaged" in reader.damage[0]
    report, _ = recovered(tmp_path, bytes(hurt))
    assert not report.header_found
