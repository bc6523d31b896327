"""Bags and MCAP files as recorders write them: several publishers and frames, other channels, odd definitions."""

from __future__ import annotations

import json

import numpy as np
import pytest

from analysis.formats import ReaderError, SeveralStreamsError, StreamChoice, read_series
from analysis.geometry import rotations
from tests import reader_files as files
from tests.unit.test_reader_bags import message

mcap_writer = pytest.importorskip("mcap.writer")
rosbag1 = pytest.importorskip("rosbags.rosbag1", reason="the extra rotdrift[ros] is not installed")
typesys = pytest.importorskip("rosbags.typesys")
STORE = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
STORE_1 = typesys.get_typestore(typesys.Stores.ROS1_NOETIC)
KIND = "geometry_msgs/msg/QuaternionStamped"
N = 60
TIMES, POSES, POSITIONS = files.motion(N)
QUATS = POSES.as_quat(scalar_first=True)
OTHER = rotations.multiply([0.9689124, 0.2474040, 0.0, 0.0], QUATS)


class Mcap:
    """An MCAP file under way."""

    def __init__(self, path, profile="ros2", **how):
        self.path = path
        self.file = path.open("wb")
        self.writer = mcap_writer.Writer(self.file, **how)
        self.writer.start(profile=profile)

    def channel(self, topic="/object", kind=KIND, definition=None, encoding="ros2msg", messages="cdr", metadata=None):
        text = STORE.generate_msgdef(kind)[0] if definition is None else definition
        schema = self.writer.register_schema(kind, encoding, text.encode())
        return self.writer.register_channel(topic, messages, schema, metadata or {})

    def orientations(self, channel, quats=QUATS, times=TIMES, stamps=None, frame="imu", head=b""):
        for t, stamp, q in zip(times, times if stamps is None else stamps, quats, strict=True):
            made = message(STORE.types, KIND, 0, stamp, np.roll(q, -1), (0, 0, 0), False, frame=frame)
            data = bytes(STORE.serialize_cdr(made, KIND))
            self.add(channel, t, head + data[len(head) :])

    def transforms(self, channel, **pairs):
        """One message at a time holds all pairs, ``parent_child`` to quaternions."""
        types = STORE.types
        for k, t in enumerate(TIMES):
            made = [
                message(
                    types,
                    "geometry_msgs/msg/TransformStamped",
                    0,
                    t,
                    np.roll(quats[k], -1),
                    (0, 0, 0),
                    False,
                    frame=name.split("_")[0],
                )
                for name, quats in pairs.items()
            ]
            for item, name in zip(made, pairs, strict=True):
                item.child_frame_id = name.split("_")[1]
            self.add(
                channel, t, bytes(STORE.serialize_cdr(types["tf2_msgs/msg/TFMessage"](made), "tf2_msgs/msg/TFMessage"))
            )

    def add(self, channel, t, data):
        at_ns = round(float(t) * 1e9)
        self.writer.add_message(channel, at_ns, data, at_ns)

    def done(self):
        self.writer.finish()
        self.file.close()
        return self.path


def assert_quats(series, quats=QUATS):
    assert len(series) == len(quats)
    assert rotations.distance(series.quats_wxyz, quats).max() < 1e-9


BESIDE = {
    "json": ("foxglove.Log", "jsonschema", "json", "{}", json.dumps({"a": 1}).encode()),
    "protobuf": ("foxglove.Log", "protobuf", "protobuf", "\n\x00", b"\x0a\x00"),
    "flatbuffer": ("foxglove.Log", "flatbuffer", "flatbuffer", "x", b"\0\0"),
    "service event": ("demo/srv/Set_Event", "ros2msg", "cdr", "uint8 x\n---\nbool ok\n", b"\0\1\0\0\1"),
    "line ends of DOS": ("demo/msg/Force", "ros2msg", "cdr", "float64 x\r\nfloat64 y\r\n", b"\0\1\0\0" + bytes(16)),
    "a definition that is no definition": ("demo/msg/Odd", "ros2msg", "cdr", "%$§ <nothing>", b"\0\1\0\0"),
    "an empty definition": ("demo/msg/Empty", "ros2msg", "cdr", "", b"\0\1\0\0"),
    "idl": ("demo/msg/Idl", "ros2idl", "cdr", "module demo { oops", b"\0\1\0\0"),
    "no schema name": ("", "", "application/octet-stream", "", b"\1\2\3"),
    "a damaged standard type": ("std_msgs/msg/String", "ros2msg", "cdr", "float64[ data", b"\0\1\0\0"),
}


@pytest.mark.parametrize("beside", BESIDE)
@pytest.mark.parametrize("profile", ["ros2", "", "ros1", "px4", "x-own"])
def test_what_stands_beside_the_wanted_topic_changes_nothing(tmp_path, beside, profile):
    kind, encoding, messages, definition, data = BESIDE[beside]
    made = Mcap(tmp_path / "a.mcap", profile)
    other = made.channel("/other", kind, definition, encoding, messages)
    for t in TIMES[::7]:
        made.add(other, t, data)
    made.orientations(made.channel())
    assert_quats(read_series(made.done()))


@pytest.mark.parametrize("definition", [None, "", "Header header\r\nQuaternion quaternion\r\n", "nonsense"])
@pytest.mark.parametrize("chunked", [True, False])
def test_standard_types_need_no_definition(tmp_path, definition, chunked):
    made = Mcap(tmp_path / "a.mcap", use_chunking=chunked)
    made.orientations(made.channel(definition=definition))
    assert_quats(read_series(made.done()))


@pytest.mark.parametrize("second", [6, 7, 8, 9, 10, 11, 2, 3])
def test_other_forms_of_cdr_are_named(tmp_path, second):
    made = Mcap(tmp_path / "a.mcap")
    made.orientations(made.channel(), head=bytes([0, second]))
    with pytest.raises(ReaderError, match=rf"not in plain CDR but in XCDR2 or a parameter list \(0x{second:02x}\)"):
        read_series(made.done())


@pytest.mark.parametrize("messages", ["json", "protobuf", "cbor", "flatbuffer"])
def test_orientations_in_another_encoding_are_named(tmp_path, messages):
    made = Mcap(tmp_path / "a.mcap")
    made.add(made.channel(messages=messages), 1.0, b"{}")
    with pytest.raises(
        ReaderError, match=rf"no topic with orientations \(its topics: /object \({KIND}, {messages}\)\)"
    ):
        read_series(made.done())
    with pytest.raises(
        ReaderError, match=f"no orientations on topic '/object' that are read: its messages are {messages}"
    ):
        read_series(tmp_path / "a.mcap", topic="/object")


@pytest.mark.parametrize("n", [2, 3])
def test_two_channels_on_one_topic_are_two_publishers(tmp_path, n):
    made = Mcap(tmp_path / "a.mcap")
    for k in range(n):
        made.orientations(made.channel(metadata={"k": str(k)}), OTHER if k % 2 else QUATS, TIMES + 0.002 * k)
    path = made.done()
    with pytest.raises(SeveralStreamsError, match=r"channels: 1, 2.*; choose with --channel 1"):
        read_series(path)
    assert_quats(read_series(path, choice=StreamChoice(channel="2")), OTHER)


def test_a_topic_that_goes_on_in_another_channel_is_one(tmp_path):
    made = Mcap(tmp_path / "a.mcap")
    made.orientations(made.channel(metadata={"offered_qos_profiles": "a"}), QUATS[:30], TIMES[:30])
    made.orientations(made.channel(metadata={"offered_qos_profiles": "b"}), QUATS[30:], TIMES[30:])
    assert_quats(read_series(made.done()))


def test_a_split_bag_whose_quality_of_service_differs_is_read_whole(tmp_path):
    bag = tmp_path / "run"
    bag.mkdir()
    names = []
    for k in range(11):  # the tenth comes behind the ninth, not behind the first
        part = slice(k * 5, None if k == 10 else k * 5 + 5)
        made = Mcap(bag / f"run_{k}.mcap")
        made.orientations(made.channel(metadata={"offered_qos_profiles": str(k)}), QUATS[part], TIMES[part])
        names.append(made.done().name)
    listed = "".join(f"  - {name}\n" for name in names)
    (bag / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n{listed}")
    assert_quats(read_series(bag))
    (bag / "run_4.mcap").unlink()
    with pytest.raises(ReaderError, match=r"run_4\.mcap, which metadata\.yaml of run names, is missing"):
        read_series(bag)


@pytest.mark.parametrize("names", [("/imu_left", "/imu_right"), ("/driver_1", "/driver_10")])
def test_two_callers_on_one_topic_of_a_ros1_bag(tmp_path, names):
    path = tmp_path / "a.bag"
    with rosbag1.Writer(path) as writer:
        for k, name in enumerate(names):
            connection = writer.add_connection("/object", KIND, typestore=STORE_1, callerid=name)
            for t, q in zip(TIMES + 0.003 * k, OTHER if k else QUATS, strict=True):
                made = message(STORE_1.types, KIND, 0, t, np.roll(q, -1), (0, 0, 0), True)
                writer.write(connection, round(t * 1e9), STORE_1.serialize_ros1(made, KIND))
    with pytest.raises(SeveralStreamsError, match=f"two channels: {names[0]}, {names[1]}; choose with --channel "):
        read_series(path)
    assert_quats(read_series(path, choice=StreamChoice(channel=names[1])), OTHER)


@pytest.mark.parametrize("frames", [("imu_left", "imu_right"), ("1", "2")])
def test_two_frames_on_one_topic_are_two_sensors(tmp_path, frames):
    made = Mcap(tmp_path / "a.mcap")
    channel = made.channel()
    for k in range(N):
        for quats, frame in zip((QUATS, OTHER), frames, strict=True):
            made.orientations(channel, quats[k : k + 1], TIMES[k : k + 1], frame=frame)
    path = made.done()
    with pytest.raises(SeveralStreamsError, match=f"two sensors: {frames[0]}, {frames[1]}; choose with --sensor"):
        read_series(path)
    assert_quats(read_series(path, choice=StreamChoice(sensor=frames[1])), OTHER)


def test_transforms_are_chosen_by_parent_and_child(tmp_path):
    made = Mcap(tmp_path / "a.mcap")
    made.transforms(made.channel("/tf", "tf2_msgs/msg/TFMessage"), world_object=QUATS, world_hand=OTHER)
    path = made.done()
    with pytest.raises(SeveralStreamsError, match="two sensors: world->hand, world->object; choose with --sensor "):
        read_series(path)
    assert_quats(read_series(path, choice=StreamChoice(sensor="world->object")))


def test_what_never_moves_is_not_a_candidate_beside_what_does(tmp_path):
    made = Mcap(tmp_path / "a.mcap")
    still = np.tile(QUATS[:1], (N, 1))
    made.transforms(made.channel("/tf_static", "tf2_msgs/msg/TFMessage"), base_camera=still)
    made.transforms(made.channel("/tf", "tf2_msgs/msg/TFMessage"), world_object=QUATS)
    assert_quats(read_series(made.done()))


@pytest.mark.parametrize("kind", ["geometry_msgs/msg/Pose", "geometry_msgs/msg/PoseWithCovarianceStamped"])
def test_poses_without_a_header_and_with_covariance(tmp_path, kind):
    made = Mcap(tmp_path / "a.mcap")
    channel, types = made.channel(kind=kind), STORE.types
    for t, q in zip(TIMES, QUATS, strict=True):
        stamped = message(types, "geometry_msgs/msg/PoseStamped", 0, t, np.roll(q, -1), (1, 2, 3), False)
        pose = stamped.pose
        if kind.endswith("Stamped"):
            pose = types[kind](stamped.header, types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)))
        made.add(channel, t, bytes(STORE.serialize_cdr(pose, kind)))
    series = read_series(made.done())
    assert_quats(series)
    np.testing.assert_allclose(series.times_s, TIMES, atol=1e-6)


@pytest.mark.parametrize("restarts", [(30,), (20, 40)])
def test_a_clock_that_starts_again_is_put_together_by_reception(tmp_path, restarts):
    stamps = TIMES - TIMES[0] + 3000.0
    for row in restarts:
        stamps[row:] -= stamps[row] - 1.0
    made = Mcap(tmp_path / "a.mcap")
    made.orientations(made.channel(), stamps=stamps)
    series = read_series(made.done())
    assert_quats(series)
    np.testing.assert_allclose(np.diff(series.times_s), 0.01, atol=1e-6)
    assert any("clock starts again" in note and "by the times of reception" in note for note in series.notes)


def test_stamps_of_two_clocks_are_told(tmp_path):
    stamps = TIMES.copy()
    stamps[30:] += 1.7e9
    made = Mcap(tmp_path / "a.mcap")
    made.orientations(made.channel(), stamps=stamps)
    series = read_series(made.done())
    np.testing.assert_allclose(np.diff(series.times_s), 0.01, atol=1e-6)
    assert any("times of two clocks; times of reception used" in note for note in series.notes)


def test_a_chunk_that_claims_too_much_is_refused(tmp_path):
    made = Mcap(tmp_path / "a.mcap")
    made.orientations(made.channel())
    data = bytearray(made.done().read_bytes())
    chunk = data.index(b"\x06", 8)  # op code of the first chunk
    data[chunk + 9 + 16 : chunk + 9 + 24] = (2**40).to_bytes(8, "little")
    made.path.write_bytes(bytes(data))
    with pytest.raises(ReaderError, match=r"has a chunk of \d+ bytes unpacked|damaged or cut off"):
        read_series(made.path)
