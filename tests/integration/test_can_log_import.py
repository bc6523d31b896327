"""Logs of other tools: a trial in them scores as our own capture of it; damaged ones end in a sentence."""

from __future__ import annotations

import contextlib
import json
import random
from pathlib import Path

import can
import numpy as np
import pytest

from analysis.confined import limits
from analysis.scoring.trial import score_series
from firmware_protocol.can.frames import CanFrame, FrameFlag, pack_frames
from host.errors import FileError
from host.links.can.logs import can_log_kind, read_can_log
from host.links.transport import FrameChunk
from host.recording.load import assemble
from tests.can_traffic import is_sample, object_at, timed
from tests.command_line import rotdrift_here
from tests.emulated_packets import trial_packets

KINDS = {"candump": ".log", "ASC": ".asc", "CSV": ".csv", "BLF": ".blf"}
START_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def frames() -> list[CanFrame]:
    packets = [packet for packet in trial_packets("fast", 12.0) if packet[0] == 2]
    return timed(object_at(3, rate_hz=200), packets, 5_000_000, START_NS)


def write_log(path: Path, frames: list[CanFrame]) -> Path:
    with can.Logger(path) as logger:
        for frame in frames:
            logger(
                can.Message(
                    timestamp=frame.host_time_ns / 1e9,
                    arbitration_id=frame.arbitration_id,
                    is_extended_id=False,
                    is_fd=frame.is_fd,
                    bitrate_switch=bool(frame.flags & FrameFlag.BITRATE_SWITCH),
                    data=frame.data,
                    channel="can0" if path.suffix == ".log" else 0,
                )
            )
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_a_trial_in_a_log_scores_as_our_own_capture_of_it(kind: str, frames: list[CanFrame], tmp_path: Path) -> None:
    own = assemble([FrameChunk(pack_frames(frames), frames[-1].host_time_ns)], "own")
    expected = score_series(own.series).to_json()
    assert expected["valid"]
    log = read_can_log(write_log(tmp_path / f"trial{KINDS[kind]}", frames))
    assert (log.kind, log.damage) == (kind, ())
    trial = assemble(log.chunks, "log")
    assert np.array_equal(trial.series.index, own.series.index)
    assert np.array_equal(trial.series.times_s, own.series.times_s)
    score = score_series(trial.series).to_json()
    assert score["theta_bar_deg"] == expected["theta_bar_deg"]
    assert score["endpoints"] == expected["endpoints"]


@pytest.mark.parametrize("kind", ["candump", "ASC", "BLF"])  # python-can's CSV has no mark for FD frames
def test_fd_frames_come_through(kind: str, tmp_path: Path) -> None:
    fd = timed(
        object_at(3, True, rate_hz=200), [p for p in trial_packets("fast", 1.0) if p[0] == 2], 5_000_000, START_NS
    )
    trial = assemble(read_can_log(write_log(tmp_path / f"t{KINDS[kind]}", fd)).chunks, "log")
    assert len(trial.series) == sum(frame.is_fd for frame in fd)


def test_bad_lines_of_a_candump_log_are_left_out_and_told(frames: list[CanFrame], tmp_path: Path) -> None:
    path = write_log(tmp_path / "trial.log", frames)
    lines = path.read_text().splitlines()
    lines[100:100] = ["nonsense", "(1.0) can0 12", "(x) can0 123#00", "\x00\x01", "(1.000000) can0 123#0"]
    path.write_text("\n".join(lines) + "\n(170000")
    log = read_can_log(path)
    assert len(log.damage) == 1
    assert len(assemble(log.chunks, "log").series) == len(assemble(read_can_log_of(frames), "own").series)


def read_can_log_of(frames: list[CanFrame]) -> list[FrameChunk]:
    return [FrameChunk(pack_frames(frames), frames[-1].host_time_ns)]


@pytest.mark.parametrize("kind", ["ASC", "CSV"])
def test_a_bad_line_costs_itself_and_is_told(kind: str, frames: list[CanFrame], tmp_path: Path) -> None:
    path = write_log(tmp_path / f"trial{KINDS[kind]}", frames)
    sound = read_can_log(path)
    lines = path.read_text().splitlines()
    bad = "1.0,zz,0,0,0,8,!!" if kind == "CSV" else lines[500].replace(" 8 ", " z ")
    path.write_text("\n".join([*lines[:500], bad, *lines[500:], ""]))
    log = read_can_log(path)
    assert [chunk.data for chunk in log.chunks] == [chunk.data for chunk in sound.chunks]
    assert log.damage == (f"1 of {len(frames) + 1} lines are no {kind} lines and are left out",)


def test_mutated_blf_files_end_in_time_and_in_words(
    frames: list[CanFrame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limits, "LEAST_S", 5.0)
    sound = write_log(tmp_path / "sound.blf", frames[:800]).read_bytes()
    rng = random.Random(6)
    for number in range(6):
        data = bytearray(sound)
        for _ in range(1 + number * 3):
            data[rng.randrange(144 if number % 2 else 4, len(data))] = rng.randrange(256)
        path = tmp_path / f"mutated{number}.blf"
        path.write_bytes(bytes(data[: rng.randrange(200, len(data))]) if number == 5 else bytes(data))
        with contextlib.suppress(FileError):  # nothing else may come of it, and it must end
            assemble(read_can_log(path).chunks, "log")


def test_a_blf_that_is_cut_is_read_up_to_there_and_told(frames: list[CanFrame], tmp_path: Path) -> None:
    path = write_log(tmp_path / "sound.blf", frames)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    log = read_can_log(path)
    assert f"of {len(data)} bytes are there" in log.damage[0]
    assert 0 < len(assemble(log.chunks, "log").series) < sum(map(is_sample, frames))


def test_a_blf_reader_that_never_ends_is_stopped(
    frames: list[CanFrame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_log(tmp_path / "sound.blf", frames[:800])
    monkeypatch.setattr(limits, "LEAST_S", 0.001)
    monkeypatch.setattr(limits, "S_PER_MB", 0.0)
    with pytest.raises(FileError, match="did not end within"):
        read_can_log(path)


def test_a_blf_is_read_in_a_folder_with_a_module_that_is_called_like_ours(
    frames: list[CanFrame], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_log(tmp_path / "sound.blf", frames[:800])
    (tmp_path / "host.py").touch()
    monkeypatch.chdir(tmp_path)
    log = read_can_log(path)
    assert log.damage == ()
    assert log.chunks


def test_other_files_are_no_can_logs(tmp_path: Path) -> None:
    for name, content in {
        "a.log": b"hello\n",
        "b.csv": b"t,w,x,y,z\n0,1,0,0,0\n",
        "c.txt": b"",
        "d": b"\x89PNG",
    }.items():
        path = tmp_path / name
        path.write_bytes(content)
        assert can_log_kind(content) is None
        with pytest.raises(FileError, match="not a CAN log"):
            read_can_log(path)
    with pytest.raises(FileError):
        read_can_log(tmp_path / "nothing")


def test_the_score_command_takes_a_log(frames: list[CanFrame], tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    from host.cli import main

    path = write_log(tmp_path / "trial.log", frames)
    assert main(["score", str(path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["valid"]
    assert result["n_endpoints"] >= 10
    assert main(["score", str(path), "--node", "4"]) == 4
    assert "node id 4" in capsys.readouterr().err
    assert main(["score", str(path), "--node", "77"]) == 2


def test_the_object_of_a_bus_is_chosen_by_its_node_wherever_a_log_is_read(
    frames: list[CanFrame], tmp_path: Path
) -> None:
    other = timed(object_at(9, rate_hz=200), [p for p in trial_packets("ideal", 3.0) if p[0] == 2], 5_000_000, START_NS)
    both = sorted([*frames, *other], key=lambda frame: frame.host_time_ns)
    log = write_log(tmp_path / "both.log", both)
    for node in (3, 9):
        done = rotdrift_here("convert", log, tmp_path / f"{node}.csv", "--node", node)
        assert done.returncode == 0, done.stderr
    own = [len((tmp_path / f"{node}.csv").read_text().splitlines()) for node in (3, 9)]
    assert own[0] != own[1]
    done = rotdrift_here("report", log, "--node", 3, "--out", tmp_path / "sub")
    assert done.returncode == 0, done.stderr
    (choices,) = (tmp_path / "sub").glob("trials/*/choices.json")
    assert json.loads(choices.read_text()) == {"node": 3}
    assert rotdrift_here("verify", tmp_path / "sub", "--no-drawings").returncode == 0
