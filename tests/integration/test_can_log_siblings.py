"""CAN logs as people have them: other buses, nodes and sessions in one log, other formats, odd lines."""

from __future__ import annotations

import itertools
import struct
from pathlib import Path

import can
import numpy as np
import pytest

from analysis.formats import SeveralStreamsError, StreamChoice
from firmware_protocol.can.frames import CanFrame
from host.errors import FileError
from host.links.can.log_kind import can_log_kind
from host.recording.elsewhere.can_logs import load_can_log
from tests.can_traffic import object_at, timed
from tests.emulated_packets import trial_packets

START_NS = 1_700_000_000_000_000_000
STEP_NS = 5_000_000


def frames_of(node: int, seconds: float = 3.0, start_ns: int = START_NS) -> list[CanFrame]:
    packets = [packet for packet in trial_packets("fast", seconds) if packet[0] == 2]
    return timed(object_at(node, rate_hz=200), packets, STEP_NS, start_ns)


@pytest.fixture(scope="module")
def three() -> list[CanFrame]:
    return frames_of(3)


def message(frame: CanFrame, channel: str | int = "can0", start_s: float = 0.0) -> can.Message:
    return can.Message(
        timestamp=frame.host_time_ns / 1e9 - start_s,
        arbitration_id=frame.arbitration_id,
        is_extended_id=False,
        data=frame.data,
        channel=channel,
    )


def written(path: Path, messages: list[can.Message]) -> Path:
    with can.Logger(path) as logger:
        for item in sorted(messages, key=lambda m: m.timestamp):
            logger(item)
    return path


def foreign(kind: str, channel: str, seconds: float = 3.0) -> list[can.Message]:
    """Frames of another device whose ids are those of node 3."""
    made = {
        "a CANopen hand": lambda k: (0x183, struct.pack("<Hih", 0x0637, 1000 * k, k)),
        "a CANopen hand's TPDO 2 to 4": lambda k: (0x283 + 0x100 * (k % 3), struct.pack("<q", k)),
        "an SDO server": lambda k: (0x583, bytes([0x43, 0, 0x10, 0, k % 256, 0, 0, 0])),
        "a motor": lambda k: (0x123 if k % 2 else 0x103, struct.pack("<d", float(k))[: 4 + k % 4]),
        "heartbeats": lambda k: (0x703, bytes([4 + k % 2])),
        "noise": lambda k: (0x183 if k % 2 else 0x203, bytes((k * j) % 256 for j in range(1, 9))),
    }[kind]
    return [
        can.Message(
            timestamp=START_NS / 1e9 + k * 0.01 + 0.0013,
            arbitration_id=made(k)[0],
            is_extended_id=False,
            data=made(k)[1],
            channel=channel,
        )
        for k in range(int(100 * seconds))
    ]


@pytest.fixture(scope="module")
def reference(three, tmp_path_factory):
    """The trial of node 3 alone, from a candump log."""
    return load_can_log(written(tmp_path_factory.mktemp("one") / "one.log", [message(frame) for frame in three]))


def matches(path: Path, expected, **how) -> bool:
    found = load_can_log(path, **how).series
    return np.array_equal(found.index, expected.series.index) and np.array_equal(
        found.quats_wxyz, expected.series.quats_wxyz
    )


def same(path: Path, other: Path, **how) -> bool:
    one, two = load_can_log(path, **how).series, load_can_log(other).series
    return np.array_equal(one.index, two.index) and np.array_equal(one.quats_wxyz, two.quats_wxyz)


@pytest.mark.parametrize("suffix", [".log", ".asc"])
@pytest.mark.parametrize(
    "kind", ["a CANopen hand", "a CANopen hand's TPDO 2 to 4", "an SDO server", "a motor", "heartbeats", "noise"]
)
def test_a_foreign_device_on_another_bus_changes_nothing(tmp_path, three, reference, kind, suffix):
    names = ("can0", "can1") if suffix == ".log" else (0, 1)
    both = written(tmp_path / f"two{suffix}", [message(f, names[1]) for f in three] + foreign(kind, names[0]))
    assert matches(both, reference)


@pytest.mark.parametrize("channels", [("can0", "can1"), ("vcan0", "slcan0")])
@pytest.mark.parametrize("nodes", [(3, 3), (3, 5)])
def test_objects_on_two_buses_are_to_be_chosen_from(tmp_path, channels, nodes, three):
    both = [message(f, channels[0]) for f in three] + [message(f, channels[1]) for f in frames_of(nodes[1])]
    path = written(tmp_path / "two.log", both)
    with pytest.raises(
        SeveralStreamsError, match=rf"two channels: {channels[0]}, {channels[1]}; choose with --channel"
    ):
        load_can_log(path)
    alone = written(tmp_path / "one.log", [message(f, channels[1]) for f in frames_of(nodes[1])])
    assert same(path, alone, choice=StreamChoice(channel=channels[1]))


@pytest.mark.parametrize("stray", [1, 2, 7, 31])
@pytest.mark.parametrize("seconds", [0.05, 0.2])
def test_a_stray_node_does_not_hide_the_trial(tmp_path, three, reference, stray, seconds):
    early = frames_of(stray, seconds, START_NS - 2_000_000_000)
    path = written(tmp_path / "a.log", [message(f) for f in (*early, *three)])
    assert matches(path, reference)
    assert any("node 3 is scored (--node chooses another)" in line for line in load_can_log(path).damage)
    assert load_can_log(path, stray).series.index[0] == 0


@pytest.mark.parametrize(
    ("apart_s", "suffix"),
    [
        (10.0, ".log"),
        (60.0, ".log"),
        (600.0, ".log"),
        (86_400.0, ".log"),
        (60.0, ".asc"),
        (60.0, ".csv"),
        (60.0, ".blf"),
    ],
)
def test_two_trials_in_one_log_are_apart_by_the_log_s_own_time(tmp_path, three, reference, apart_s, suffix):
    later = frames_of(3, 3.0, START_NS + round((apart_s + 3.0) * 1e9))
    channel = "can0" if suffix == ".log" else 0
    path = written(tmp_path / f"a{suffix}", [message(f, channel) for f in (*three, *later)])
    with pytest.raises(
        SeveralStreamsError, match=rf"two sessions: 1 \(from 0\.0 s\), 2 \(from {apart_s + 3.0:.1f} s\)"
    ):
        load_can_log(path)
    for session in (1, 2):
        assert matches(path, reference, choice=StreamChoice(session=session))


def test_a_log_appended_to_another_one(tmp_path, three):
    first = written(tmp_path / "a.log", [message(f) for f in three])
    before = written(tmp_path / "b.log", [message(f, start_s=1000.0) for f in three])
    first.write_text(first.read_text() + before.read_text())
    with pytest.raises(SeveralStreamsError, match="two sessions: "):
        load_can_log(first)


def test_times_of_two_clocks_in_one_log_are_told(tmp_path, three):
    absolute = written(tmp_path / "a.log", [message(f) for f in three])
    relative = written(tmp_path / "b.log", [message(f, start_s=START_NS / 1e9) for f in three])
    relative.write_text(relative.read_text() + absolute.read_text())
    trial = load_can_log(relative, choice=StreamChoice(session=2))
    assert any("mixes times since its start with times since 1970" in line for line in trial.damage)


# Formats


def screen_line(frame: CanFrame, time: str | None) -> str:
    stamp = "" if time is None else f" ({time}) "
    return f"{stamp} can0  {frame.arbitration_id:03X}   [{len(frame.data)}]  {frame.data.hex(' ').upper()}"


@pytest.mark.parametrize("origin_s", [0.0, START_NS / 1e9])
def test_what_candump_prints_with_times_is_read(tmp_path, three, reference, origin_s):
    shift = START_NS / 1e9 - origin_s
    lines = [screen_line(f, f"{f.host_time_ns / 1e9 - shift:.6f}") for f in three]
    path = tmp_path / "a.log"
    path.write_text("\n".join(lines) + "\n")
    assert matches(path, reference)


@pytest.mark.parametrize("times", ["none", "differences"])
def test_what_candump_prints_without_usable_times_is_refused(tmp_path, three, times):
    deltas = itertools.chain([100.0], itertools.repeat(0.002))
    lines = [screen_line(f, None if times == "none" else f"{next(deltas):.6f}") for f in three]
    (tmp_path / "a.log").write_text("\n".join(lines) + "\n")
    with pytest.raises(FileError, match="candump -l"):
        load_can_log(tmp_path / "a.log")


def trc(frames: list[CanFrame], version: str) -> str:
    head = {
        "1.0": ";   Start time: 01.05.2024 12:00:00\n;\n",
        "1.1": ";$FILEVERSION=1.1\n;$STARTTIME=45413.5\n;\n",
        "1.3": ";$FILEVERSION=1.3\n;$STARTTIME=45413.5\n;\n",
        "2.0": ";$FILEVERSION=2.0\n;$STARTTIME=45413.5\n;$COLUMNS=N,O,T,I,d,L,D\n;\n",
        "2.1": ";$FILEVERSION=2.1\n;$STARTTIME=45413.5\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n;\n",
        "1.2": ";$FILEVERSION=1.2\n;$STARTTIME=45413.5\n;\n",
    }[version]
    lines = []
    for k, f in enumerate(frames):
        ms, can_id, data = (f.host_time_ns - START_NS) / 1e6, f"{f.arbitration_id:04X}", f.data.hex(" ").upper()
        n = len(f.data)
        lines.append(
            {
                "1.0": f"{k + 1:6d}) {ms:11.0f}  {can_id}  {n}  {data}",
                "1.1": f"{k + 1:6d}) {ms:11.1f}  Rx  {can_id}  {n}  {data}",
                "1.3": f"{k + 1:6d}) {ms:11.3f} 1  Rx  {can_id} -  {n}  {data}",
                "2.0": f"{k + 1:7d} {ms:13.3f} DT {can_id} Rx {n} {data}",
                "2.1": f"{k + 1:7d} {ms:13.3f} DT 1 {can_id} Rx - {n} {data}",
                "1.2": f"{k + 1:6d}) {ms:11.3f} 1  Rx  {can_id}  {n}  {data}",
            }[version]
        )
    return head + "\n".join(lines) + "\n"


@pytest.mark.parametrize("version", ["1.0", "1.1", "1.3", "2.0", "2.1"])
def test_every_version_of_trc_is_read(tmp_path, three, reference, version):
    path = tmp_path / "a.trc"
    path.write_text(trc(three, version))
    assert matches(path, reference)


def test_a_version_of_trc_that_is_not_read_is_named(tmp_path, three):
    (tmp_path / "a.trc").write_text(trc(three, "1.2"))
    with pytest.raises(FileError, match=r"TRC version 1\.2 is not read: save it as one of 1\.0, 1\.1"):
        load_can_log(tmp_path / "a.trc")


ASC_LINES = [
    "   0.500000 CANFD   Start of measurement",
    "   0.500000 Start of measurement",
    "   0.500000 CAN 1 Status:chip status error active",
    "   0.500000 1  Statistic: D 100 R 0 XD 0 XR 0 E 0 O 0 B 10.00%",
    "   0.500000 SV: 1 0 1 ::Speed = 1",
    "// a remark",
    "   0.500000 1  ErrorFrame",
    "   0.500000 log trigger event",
    "   0.500000 CANFD 1 Rx ErrorFrame",
    "   0.500000 J1939TP FEE3p 6 0 0 - Rx d 23 A0 0F A6 60 3B D1",
]


@pytest.mark.parametrize("line", ASC_LINES)
@pytest.mark.parametrize("place", ["first", "middle"])
def test_events_in_an_asc_cost_nothing(tmp_path, three, reference, line, place):
    path = written(tmp_path / "a.asc", [message(f, 0) for f in three])
    lines = path.read_text().splitlines()
    first = next(k for k, text in enumerate(lines) if " Rx " in text)
    lines.insert({"first": first, "middle": first + 200}[place], line)
    path.write_text("\n".join(lines) + "\n")
    assert matches(path, reference)
    assert load_can_log(path).damage == ()


@pytest.mark.parametrize("drop", ["date", "base", "internal events", "//", "Begin"])
def test_an_asc_whose_header_lacks_a_line_loses_no_frame(tmp_path, three, reference, drop):
    path = written(tmp_path / "a.asc", [message(f, 0) for f in three])
    lines = [line for line in path.read_text().splitlines() if not line.startswith(drop)]
    if can_log_kind("\n".join(lines).encode()) is None:
        pytest.skip("not recognised as an ASC without it")
    path.write_text("\n".join(lines) + "\n")
    assert matches(path, reference)


@pytest.mark.parametrize("by_s", [0.5, 2.0, 100.0])
def test_negative_times_of_an_asc_are_times(tmp_path, three, reference, by_s):
    path = written(tmp_path / "a.asc", [message(f, 0) for f in three])
    lines = []
    for line in path.read_text().splitlines():
        cells = line.split(None, 1)
        if " Rx " in line:
            lines.append(f"{float(cells[0]) - by_s:11.6f} {cells[1]}")
        else:
            lines.append(line)
    path.write_text("\n".join(lines) + "\n")
    assert matches(path, reference)
    assert load_can_log(path).damage == ()


def test_relative_times_of_an_asc_are_added_up(tmp_path, three):
    later = frames_of(3, 3.0, START_NS + 100_000_000_000)
    path = written(tmp_path / "a.asc", [message(f, 0) for f in (*three, *later)])
    lines, before = [], 0.0
    for line in path.read_text().replace("timestamps absolute", "timestamps relative").splitlines():
        cells = line.split(None, 1)
        if " Rx " in line:
            now = float(cells[0])
            lines.append(f"{now - before:11.6f} {cells[1]}")
            before = now
        else:
            lines.append(line)
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(SeveralStreamsError, match=r"2 \(from 100\.0 s\)"):
        load_can_log(path)


@pytest.mark.parametrize("kind", [".log", ".asc", ".csv", ".trc"])
@pytest.mark.parametrize("n_bad", [1, 7])
def test_lines_that_are_left_out_are_counted(tmp_path, three, kind, n_bad):
    path = tmp_path / f"a{kind}"
    if kind == ".trc":
        path.write_text(trc(three, "1.1"))
    else:
        written(path, [message(f, "can0" if kind == ".log" else 0) for f in three])
    lines = path.read_text().splitlines()
    for k in range(n_bad):
        lines.insert(100 + 11 * k, "\x01\x02 garbage 12")
    path.write_text("\n".join(lines) + "\n")
    name = {".log": "candump", ".asc": "ASC", ".csv": "CSV", ".trc": "TRC"}[kind]
    assert load_can_log(path).damage == (f"{n_bad} of {len(three) + n_bad} lines are no {name} lines and are left out",)
