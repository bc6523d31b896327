"""Long and loaded, shortened: flat memory, nothing lost, and nothing left behind when it ends."""

import json
import os
import signal
import sys
import threading
from pathlib import Path

import pytest

from benchmarks.soak import soak
from host.virtual_object_process import VirtualObjectProcess
from tests.command_line import quick_scenario, started, wait_for_line

LINUX = sys.platform.startswith("linux")


@pytest.mark.skipif(not LINUX, reason="reads /proc")
def test_six_minutes_in_virtual_time_lose_nothing_and_grow_by_nothing(tmp_path):
    threads = threading.active_count()
    result = soak(360.0, 200, warm_up_s=120.0, folder=tmp_path)
    assert result.missing == 0
    assert result.samples == result.produced > 70_000
    assert result.cycles == pytest.approx(89, abs=2)
    assert result.growth_mb <= 8  # what a minute more of cycles takes, and the noise of the allocator
    assert result.warnings == ()
    assert threading.active_count() == threads


@pytest.mark.skipif(sys.platform == "win32", reason="needs ptys and POSIX signals")
def test_ctrl_c_closes_the_recording_and_leaves_nothing(tmp_path):  # how soon: benchmarks.reaction_times
    recording = tmp_path / "trial.mcap"
    with (
        VirtualObjectProcess(quick_scenario(tmp_path)) as virtual,
        started("capture", virtual.link, "--out", recording, "--json") as capture,
    ):
        capture.stderr.up_to("cycle   4")
        children_before = children(capture.pid)
        capture.send_signal(signal.SIGINT)
        done = capture.finish()
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["capture"]["ended"] == "stopped by the operator"
    assert recording.read_bytes().endswith(b"\x89MCAP0\r\n")  # the footer is written
    assert not [pid for pid in children_before if Path(f"/proc/{pid}").exists()] or not LINUX
    if LINUX:  # nobody holds the port any more
        assert not holders(virtual.link.removeprefix("serial:"))


def children(pid):
    """Processes that a process has started."""
    path = Path(f"/proc/{pid}/task/{pid}/children")
    return path.read_text().split() if path.exists() else []


def holders(device):
    """Processes that have a device open."""
    from host.links.serial.listing import port_owners

    return port_owners(device)


@pytest.mark.skipif(not LINUX, reason="reads /proc")
def test_captures_in_one_process_leave_no_thread_and_no_descriptor(tmp_path):
    from host.capture.run import run_capture
    from host.capture.settings import CaptureSettings
    from host.screen.screens import QuietScreen

    def descriptors():
        links = [link for link in Path("/proc/self/fd").iterdir() if os.path.lexists(link)]
        return sorted(str(link.readlink()) for link in links)

    scenario = quick_scenario(tmp_path)
    before = descriptors()  # a terminal of an earlier test in this process may still be open
    counts = []
    for number in range(3):
        with VirtualObjectProcess(scenario) as virtual:
            finished = run_capture(
                virtual.link,
                tmp_path / f"{number}.mcap",
                CaptureSettings(duration_s=0.8, debug_link=tmp_path / f"{number}.txt"),
                QuietScreen(),
                threading.Event(),
            )
        assert finished.outcome.reason == "0.8 s are over"
        names = sorted(thread.name for thread in threading.enumerate())
        counts.append(
            (names, [name for name in descriptors() if name not in before and (str(tmp_path) in name or "pts" in name)])
        )
    assert counts[0] == counts[1] == counts[2]
    assert counts[0][1] == []


def test_the_virtual_object_stops_and_takes_its_device_with_it(tmp_path):
    if sys.platform == "win32":
        pytest.skip("needs ptys")
    with started("emulate", "--scenario", "static", "--link", f"pty:{tmp_path / 'object'}") as process:
        wait_for_line(process, "ready: ")
        process.send_signal(signal.SIGTERM)
        assert process.exit_code() == 0
    assert not os.path.lexists(tmp_path / "object")
