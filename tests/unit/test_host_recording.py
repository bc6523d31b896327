"""Recordings: exact, never over another file, readable when cut."""

import json
import threading
import zlib

import mcap.reader
import mcap.stream_reader
import mcap.writer
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.packets import Info, Status
from host.errors import FileError
from host.links import open_transport
from host.links.transport import Chunk, FrameChunk, LinkEnd
from host.recording import format as fmt
from host.recording.cdr import RosField, RosMessageType
from host.recording.reader import RecordingReader, is_our_recording
from host.recording.replay_link import ReplayTransport
from tests.small_recordings import MONO, WALL, chunks, writer


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "trial.mcap"
    with_writer = writer(path)
    for chunk in chunks():
        with_writer.add_received(chunk)
        with_writer.add_orientations(
            np.array([chunk.host_time_ns]), np.array([[0.5, 0.5, -0.5, 0.5]]), chunk.host_time_ns
        )
    with_writer.add_sent(b"\x00command\x00", MONO + 7)
    with_writer.add_packet(Info(device_id=2**64 - 1, boot_id=3, name="cube \x1b[2J"), MONO + 8)
    with_writer.add_packet(Status(uptime_us=5), MONO + 9)
    with_writer.add_note("warning", "the hand stopped", MONO + 10)
    with_writer.close()
    return path


def test_chunks_come_back_exactly(recording):
    reader = RecordingReader(recording)
    assert list(reader.chunks()) == chunks()
    assert list(reader.chunks(fmt.SENT)) == [Chunk(b"\x00command\x00", MONO + 7)]
    assert reader.damage == []
    header = reader.header
    assert (header.link, header.wall_time_ns, header.monotonic_ns) == ("serial:/dev/ttyACM0", WALL, MONO)
    assert header.settings == {"cycles": 10}


def test_frames_of_a_can_link_come_back_as_frames(tmp_path):
    sink = writer(tmp_path / "can.mcap")
    sink.add_received(FrameChunk(b"CF packed", MONO))
    sink.close()
    assert list(RecordingReader(tmp_path / "can.mcap").chunks()) == [FrameChunk(b"CF packed", MONO)]


def test_rare_packets_and_notes_come_back(recording):
    messages = {m.topic: m for m in RecordingReader(recording).messages([fmt.INFO, fmt.STATUS, fmt.NOTE])}
    info = messages[fmt.INFO].values()
    assert info["device_id"] == 2**64 - 1
    assert info["name"] == "cube [2J"
    assert json.loads(info["card"])["mass_g"] is None  # NaN is no JSON
    assert np.isnan(messages[fmt.STATUS].values()["temperature_c"])
    assert messages[fmt.NOTE].values() == {"kind": "warning", "text": "the hand stopped"}
    assert messages[fmt.NOTE].time_ns == WALL + 10


def test_the_library_reads_it_by_index_with_valid_checksums(recording):
    with recording.open("rb") as file:
        records = list(mcap.stream_reader.StreamReader(file, validate_crcs=True).records)
    assert records
    with recording.open("rb") as file:
        summary = mcap.reader.make_reader(file).get_summary()
    topics = {
        channel.topic: summary.statistics.channel_message_counts.get(i, 0) for i, channel in summary.channels.items()
    }
    assert topics[fmt.RECEIVED] == topics[fmt.ORIENTATION] == 20
    assert min(summary.channels) == next(i for i, c in summary.channels.items() if c.topic == fmt.RECEIVED)


def ros_messages(path):
    """Everything ROS tools see in a recording: (topic, message)."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([path]) as reader:
        return [(c.topic, reader.deserialize(raw, c.msgtype)) for c, _, raw in reader.messages()]


def test_ros_opens_the_recording_and_reads_every_channel(recording):
    messages = ros_messages(recording)
    quaternions = [message for topic, message in messages if topic == fmt.ORIENTATION]
    last = quaternions[-1]
    assert (last.quaternion.x, last.quaternion.y, last.quaternion.z, last.quaternion.w) == (0.5, -0.5, 0.5, 0.5)
    assert last.header.frame_id == "world"
    assert last.header.stamp.sec * 10**9 + last.header.stamp.nanosec == WALL + 19_000_000
    raw = [message for topic, message in messages if topic == fmt.RECEIVED]
    assert [(r.data.tobytes(), r.host_time_ns) for r in raw] == [(c.data, c.host_time_ns) for c in chunks()]
    seen = dict(messages)
    assert seen[fmt.INFO].device_id == 2**64 - 1
    assert seen[fmt.INFO].firmware_version == "0.0.0"
    assert seen[fmt.STATUS].uptime_us == 5
    assert seen[fmt.STATUS].gyro_bias_dps.tolist() == [0.0, 0.0, 0.0]
    assert seen[fmt.NOTE].text == "the hand stopped"


def test_the_reader_of_bags_finds_the_same_orientations_as_the_raw_bytes(tmp_path):
    pytest.importorskip("rosbags")
    from analysis.formats import read_series
    from host.capture.run import run_capture
    from host.capture.settings import CaptureSettings
    from host.recording.load import load_trial
    from host.screen.screens import QuietScreen
    from tests.recorded_trials import scenario, virtual_chunks, write_recording

    virtual, _ = virtual_chunks(scenario("ideal"), duration_s=4.0)
    source = write_recording(tmp_path / "source.mcap", virtual)
    path = tmp_path / "trial.mcap"
    run_capture(f"replay:{source}", path, CaptureSettings(), QuietScreen(), threading.Event())
    ours, bag = load_trial(path).series, read_series(path)
    np.testing.assert_allclose(bag.quats_wxyz, ours.quats_wxyz, atol=1e-12)
    np.testing.assert_allclose(bag.times_s - bag.times_s[0], ours.times_s, atol=2e-3)


def test_our_cdr_is_that_of_ros():
    typesys = pytest.importorskip("rosbags.typesys")
    kind = RosMessageType(
        "a/msg/B",
        (
            RosField("bool", "flag"),
            RosField("float64", "number"),
            RosField("string", "text"),
            RosField("uint16[3]", "three"),
            RosField("int64", "large"),
            RosField("string", "empty"),
            RosField("uint8", "small"),
            RosField("float32", "single"),
        ),
    )
    values = {
        "flag": True,
        "number": -1.5,
        "text": "θ̄ x",
        "three": [1, 2, 65535],
        "large": -(2**60),
        "empty": "",
        "small": 255,
        "single": 0.25,
    }
    store = typesys.get_typestore(typesys.Stores.EMPTY)
    store.register(typesys.get_types_from_msg(kind.definition.decode(), kind.name))
    theirs = store.types[kind.name](**{**values, "three": np.array(values["three"], np.uint16)})
    assert kind.encode(values) == bytes(store.serialize_cdr(theirs, kind.name))
    assert kind.decode(kind.encode(values)) == values
    with pytest.raises(ValueError, match="too short"):
        kind.decode(kind.encode(values)[:20])
    with pytest.raises(ValueError, match="not little-endian"):
        kind.decode(b"{}")


def test_the_schemas_are_those_of_ros(recording):
    typesys = pytest.importorskip("rosbags.typesys")
    ours = typesys.get_types_from_msg(fmt.QUATERNION_SCHEMA.decode(), fmt.QUATERNION_SCHEMA_NAME)
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for name, definition in ours.items():
        assert [field[0] for field in store.fielddefs[name][1]] == [field[0] for field in definition[1]]


def test_an_existing_file_is_never_touched(recording):
    before = recording.read_bytes()
    with pytest.raises(FileError, match=r"exists already.*--out"):
        writer(recording)
    assert recording.read_bytes() == before


def test_a_folder_that_cannot_be_made_is_a_sentence(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="file"):
        writer(tmp_path / "file" / "trial.mcap")


@pytest.mark.parametrize(
    ("content", "said"),
    [(b"", "is empty"), (b"hello, this is text", "is not a recording"), (b"\x89MCA", "is not a recording")],
)
def test_what_is_no_recording_is_said(tmp_path, content, said):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(FileError, match=said):
        RecordingReader(path)
    assert not is_our_recording(path)


def test_an_mcap_file_of_others_is_said(tmp_path):
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        other = mcap.writer.Writer(file)
        other.start()
        other.add_message(other.register_channel("/imu", "cdr", 0), 0, b"x", 0)
        other.finish()
    with pytest.raises(FileError, match="not a recording of rotdrift"):
        RecordingReader(path)
    with pytest.raises(FileError, match="there is no file"):
        RecordingReader(tmp_path / "nothing.mcap")


def test_cut_anywhere_gives_a_prefix_and_says_so(recording, tmp_path):
    whole = recording.read_bytes()
    cut = tmp_path / "cut.mcap"
    start = whole.index(fmt.encode_raw(chunks()[0])[:16]) - 40
    seen = set()
    for end in range(start, len(whole) - 1, 97):
        cut.write_bytes(whole[:end])
        reader = RecordingReader(cut)
        got = list(reader.chunks())
        assert got == chunks()[: len(got)]
        seen.add(len(got))
        if len(got) < 20:
            assert "was not closed" in reader.damage[0]
    assert {0, 20} <= seen


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_a_damaged_byte_never_gives_a_wrong_chunk(tmp_path_factory, data):
    folder = tmp_path_factory.getbasetemp() / "damage"
    folder.mkdir(exist_ok=True)
    path = folder / "whole.mcap"
    if not path.exists():
        sink = writer(path)
        for chunk in chunks():
            sink.add_received(chunk)
        sink.close()
    content = bytearray(path.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    hurt = folder / "hurt.mcap"
    hurt.write_bytes(content)
    try:
        reader = RecordingReader(hurt)
        got = list(reader.chunks())
    except FileError:
        return
    known = chunks()
    assert all(chunk in known for chunk in got)
    assert len(got) >= 19 or reader.damage or at < 3000


def test_a_file_rewritten_with_chunks_reads_the_same(recording, tmp_path):
    path = tmp_path / "chunked.mcap"
    with recording.open("rb") as source, path.open("wb") as target:
        out = mcap.writer.Writer(target, chunk_size=500)
        out.start()
        ids = {}
        for record in mcap.stream_reader.StreamReader(source).records:
            if isinstance(record, mcap.records.Metadata):
                out.add_metadata(record.name, record.metadata)
            elif isinstance(record, mcap.records.Channel) and record.id not in ids:
                ids[record.id] = out.register_channel(record.topic, record.message_encoding, 0)
            elif isinstance(record, mcap.records.Message):
                out.add_message(ids[record.channel_id], record.log_time, record.data, record.publish_time)
        out.finish()
    assert list(RecordingReader(path).chunks()) == chunks()


def test_a_replay_delivers_the_same_chunks_and_ends(recording):
    with open_transport(f"replay:{recording}") as link:
        assert not link.is_live
        assert [link.read(0.1) for _ in range(20)] == chunks()
        with pytest.raises(LinkEnd):
            link.read(0.1)


def test_a_paced_replay_waits_as_long_as_it_took(recording):
    now = [0]

    def sleep(seconds):
        now[0] += round(seconds * 1e9)

    link = ReplayTransport(recording, speed=0.5, now_ns=lambda: now[0], sleep=sleep)
    got = []
    while len(got) < 20:
        chunk = link.read(0.0005)
        if chunk is not None:
            got.append(now[0])
    assert got == pytest.approx([i * 2_000_000 for i in range(20)], abs=2000)


def test_message_definitions_change_only_with_the_version_of_the_format():
    """Other tools take two definitions of one type for two types: old and new recordings must have the same."""
    definitions = b"".join(topic.name.encode() + bytes(topic.schema) for topic in fmt.TOPICS)
    assert (fmt.FORMAT_VERSION, zlib.crc32(definitions)) == (1, 0xF6E9B5CE)


@pytest.mark.parametrize("kind", [Chunk, FrameChunk])
def test_a_time_that_no_clock_counts_is_damage_in_front_of_numpy(tmp_path, kind):
    path = tmp_path / "trial.mcap"
    times_ns = [MONO, 2**63, MONO + 1, 2**64 - 1, 2**63 - 1]
    with_writer = writer(path)
    for time_ns in times_ns:
        with_writer.add_received(kind(b"abc\0", time_ns))
    with_writer.close()
    reader = RecordingReader(path)
    assert [chunk.host_time_ns for chunk in reader.chunks()] == [MONO, MONO + 1]
    damage = "3 records of /raw/received are damaged (no clock reads the time at which it was received) and left out"
    assert reader.damage == [damage]
    spans = list(reader.spans())
    assert b"".join(span.data for span in spans) == b"abc\0" * 2
    assert reader.damage == [damage]
