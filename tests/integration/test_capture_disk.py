"""Disks that fill up, folders that cannot be written, files that vanish: real ones, under a real capture."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from host.virtual_object_process import VirtualObjectProcess
from tests.command_line import BASE, environment, one_sentence, quick_scenario, rotdrift, rotdrift_here, started
from tests.waiting import HANG_S, wait_for

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs ptys and limits of POSIX")

LIMIT_BYTES = 80_000


def small_files():
    """A limit on the size of any file stands for a full disk: writing fails when it is reached."""
    import resource

    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT_BYTES, LIMIT_BYTES))


def test_a_full_disk_is_told_and_the_trial_scored_from_memory(tmp_path):
    recording = tmp_path / "trial.mcap"
    with VirtualObjectProcess(quick_scenario(tmp_path)) as virtual:
        done = subprocess.run(
            [*BASE, "capture", virtual.link, "--cycles", "8", "--out", str(recording), "--json"],
            env=environment(),
            preexec_fn=small_files,
            capture_output=True,
            text=True,
            timeout=HANG_S,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    assert recording.stat().st_size <= LIMIT_BYTES
    result = json.loads(done.stdout)
    told = " ".join(result["capture"]["warnings"])
    assert "kept in memory until it can be written" in told
    assert "is cut" in told
    # The whole trial is scored, though half of it never reached the disk.
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.01)
    assert result["losses"]["missing"] == 0
    assert result["n_endpoints"] >= 8
    on_disk = load_trial(recording)
    assert "was not closed" in on_disk.damage[0]
    assert 0 < len(on_disk.series) < result["losses"]["received"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_result_that_cannot_be_written_is_a_sentence_and_keeps_the_recording(tmp_path):
    recording = tmp_path / "trial.mcap"
    recording.with_suffix(".json").symlink_to("/dev/full")
    with VirtualObjectProcess(quick_scenario(tmp_path)) as virtual:
        done = rotdrift("capture", virtual.link, "--cycles", 4, "--out", recording)
    assert done.returncode == 4
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_is_said_before_anything_starts(tmp_path):
    folder = tmp_path / "read-only"
    folder.mkdir(mode=0o500)
    with VirtualObjectProcess(quick_scenario(tmp_path)) as virtual:
        refused = rotdrift_here("capture", virtual.link, "--out", folder / "trial.mcap")
    assert "permission denied" in one_sentence(refused, 4)


def test_a_folder_that_cannot_even_be_made_is_said_before_anything_starts(tmp_path):
    (tmp_path / "file").touch()
    with VirtualObjectProcess(quick_scenario(tmp_path)) as virtual:
        refused = rotdrift_here("capture", virtual.link, "--out", tmp_path / "file" / "trial.mcap")
        nowhere = rotdrift_here("capture", virtual.link, "--out", "/proc/rotdrift/trial.mcap")
    one_sentence(refused, 4)
    assert "cannot be created" in one_sentence(nowhere, 4)


def test_a_recording_removed_under_a_capture_is_written_again(tmp_path):
    recording = tmp_path / "trial.mcap"
    with (
        VirtualObjectProcess(quick_scenario(tmp_path)) as virtual,
        started("capture", virtual.link, "--cycles", 5, "--out", recording, "--json") as capture,
    ):
        wait_for(lambda: recording.exists() and recording.stat().st_size > 20_000, "data on disk")
        recording.unlink()
        done = capture.finish()
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert any("removed meanwhile and written again" in warning for warning in result["capture"]["warnings"])
    trial = load_trial(recording)
    assert trial.losses.missing == 0
    assert trial.losses.received == result["losses"]["received"]


@pytest.mark.parametrize("kill_after_bytes", [1_000, 60_000])
def test_a_capture_killed_at_any_moment_leaves_a_recording_that_is_whole_up_to_there(tmp_path, kill_after_bytes):
    """How much is lost: benchmarks.reaction_times."""
    recording, log = tmp_path / "trial.mcap", tmp_path / "link.txt"
    with (
        VirtualObjectProcess(quick_scenario(tmp_path)) as virtual,
        started("capture", virtual.link, "--out", recording, "--debug-link", log) as capture,
    ):
        # Between flushes, not just after one: the log of the link grows with every read.
        wait_for(lambda: log.exists() and log.stat().st_size > kill_after_bytes, "data")
        os.kill(capture.pid, signal.SIGKILL)
        capture.exit_code()
    chunks = list(RecordingReader(recording).chunks())
    # The log of the link says what was received, and when.
    lines = [line.split() for line in log.read_text().splitlines()[:-1] if not line.startswith("#")]
    reads = [(float(line[0]), bytes.fromhex("".join(line[3:]))) for line in lines if line[1] == "<"]
    received = b"".join(data for _, data in reads)
    recorded = b"".join(chunk.data for chunk in chunks)
    assert received.startswith(recorded[: len(received)])
    if kill_after_bytes > 10_000:
        assert load_trial(recording).losses.missing == 0
    replayed = rotdrift_here("recover", recording, tmp_path / "clean.mcap", "--json")
    assert replayed.returncode == 0
    found = json.loads(replayed.stdout)
    assert (found["chunks"], found["missing_chunks"]) == (len(chunks), 0)
