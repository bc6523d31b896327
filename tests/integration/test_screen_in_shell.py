"""The live screen under a shell's job control: stopped, brought back, and what a stranger may do to a terminal."""

import json
import os
import re
import shlex
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest

from tests.command_line import BASE, quick_scenario, wait_for

pytest.importorskip("pexpect")
pytest.importorskip("pyte")
if sys.platform == "win32":
    pytest.skip("needs a pseudo-terminal", allow_module_level=True)

from host.capture.playback import recorded_actions
from host.virtual_object_process import VirtualObjectProcess
from tests.terminal_run import Terminal


@pytest.fixture
def virtual(tmp_path):
    with VirtualObjectProcess(quick_scenario(tmp_path)) as process:
        yield process


def children(pid):
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def accounted(recording):
    """Check that every sample is here or counted as missing: a machine that stalls for seconds may lose some."""
    losses = json.loads(recording.with_suffix(".json").read_text())["losses"]
    assert losses["received"] > 100
    assert losses["produced"] == losses["received"] + losses["missing"]
    return losses


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks up the job's process in /proc")
@pytest.mark.skipif(shutil.which("bash") is None, reason="needs a shell with job control")
def test_a_job_that_was_stopped_is_brought_back_by_fg(tmp_path, virtual):
    """SIGTSTP (Control-Z typed elsewhere) is refused; SIGSTOP cannot be: after ``fg`` all is as before, and counted."""
    recording = tmp_path / "trial.mcap"
    shell = Terminal([], tmp_path, shell="bash", PS1="ready> ")
    shell.wait_for("ready>")
    command = shlex.join([*BASE, "capture", virtual.link, "--out", str(recording)])
    shell.press("stty -a > before\n" + command + "\n")
    shell.wait_for_cycles(2)
    (capture,) = children(shell.process.pid)
    os.killpg(capture, signal.SIGTSTP)
    shell.wait_for_cycles(3)  # it goes on
    stopped_s = time.monotonic()
    os.killpg(capture, signal.SIGSTOP)
    shell.wait_for("Stopped")
    shell.press("fg\n")
    cycles = int(re.search(r"(\d+) cycles ·", shell.wait_for("cycles ·"))[1])
    stopped_s = time.monotonic() - stopped_s
    seen = shell.wait_for_cycles(cycles + 2)
    assert "rotdrift capture · virtual cube" in seen  # drawn anew, not only the lines that changed
    shell.press("m")  # keys come one by one again
    shell.wait_for("marker 1")
    shell.press("q")
    shell.wait_for("ready>")
    wait_for(recording.with_suffix(".json").exists, what="the result")
    shell.press("\nstty -a > after\nexit\n")
    shell.finish()
    assert (tmp_path / "after").read_text() == (tmp_path / "before").read_text()
    losses = accounted(recording)
    # The link's own buffers hold some seconds of samples at this rate; a machine that took longer lost, and counted.
    assert losses["missing"] == 0 or stopped_s > 1.0


def test_junk_odd_sizes_and_early_keys_change_nothing(tmp_path):
    """Keys before there is anything, special keys, a paste full of commands, a window dragged to next to nothing."""
    recording = tmp_path / "trial.mcap"
    with VirtualObjectProcess(quick_scenario(tmp_path, lead_in_s=4.0)) as virtual:
        terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path, 120, 36)
        terminal.wait_for("needs 4 more cycles")
        terminal.press("f\x1b[A\x1bOP\x1b[<0;5;5M\x1b[200~quit\rsxn\x1b[201~\x00\x07ü☃x")
        terminal.wait_for("no cycle yet")
        for width, height in ((40, 10), (20, 3), (300, 100), (1, 1), (61, 17)):
            terminal.resize(width, height)
            terminal.read()
        terminal.wait_for("cycle")
        terminal.resize(80, 24)
        terminal.wait_for_cycles(4)
        terminal.wait_for("finish")
        terminal.press("na \x1b[Dnote\r")  # an arrow key on the way
        terminal.wait_for("a note")
        terminal.press("q")
        assert terminal.finish() == 0
        assert terminal.modes() == terminal.modes_before
        assert "\x1b[?2004h" in terminal.raw
        assert terminal.raw.rindex("\x1b[?2004l") > terminal.raw.rindex("\x1b[?2004h")
    kinds = [(action.kind, action.text) for action in recorded_actions(recording)]
    assert kinds == [("note", "a note"), ("finish", "")]
    accounted(recording)


def test_a_closed_window_ends_the_capture_in_order(tmp_path, virtual):
    """A lost ssh connection, a closed window: the recording is closed, the result written, nothing complains."""
    recording = tmp_path / "trial.mcap"
    terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path)
    terminal.wait_for_cycles(4)
    terminal.process.ptyproc.fileobj.close()  # hangs up, as the system does when the window goes
    deadline = time.monotonic() + 20
    while terminal.process.ptyproc.isalive() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert terminal.process.ptyproc.exitstatus == 0
    result = json.loads(recording.with_suffix(".json").read_text())
    assert result["capture"]["ended"] == "stopped by the operator"
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.01)
    accounted(recording)


def test_a_pulled_cable_is_seen_and_its_return_counted(tmp_path):
    cut = '[[faults.at]]\nkind = "unplug"\nat_s = 2.0\nfor_s = 5.0\n'
    recording = tmp_path / "trial.mcap"
    with VirtualObjectProcess(quick_scenario(tmp_path, device=cut)) as virtual:
        terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path)
        terminal.wait_for("0 reconnects")
        terminal.wait_for("DISCONNECTED")
        terminal.wait_for("ALARM link: nothing has come for")
        terminal.wait_for("1 reconnect ")
        seen = terminal.wait_for("the link was lost and is open again")
        assert "DISCONNECTED" not in seen
        assert "0 reconnects" not in seen
        terminal.press("q")
        terminal.finish()
        assert terminal.modes() == terminal.modes_before
    assert json.loads(recording.with_suffix(".json").read_text())["link"]["reconnects"] == 1


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks up the drawing process in /proc")
def test_when_the_drawing_process_dies_the_capture_goes_on_in_lines(tmp_path, virtual):
    recording = tmp_path / "trial.mcap"
    terminal = Terminal(["capture", virtual.link, "--out", recording, "--cycles", 8], tmp_path)
    terminal.wait_for_cycles(2)
    (drawing,) = children(terminal.process.pid)
    os.kill(drawing, signal.SIGKILL)
    assert terminal.finish() == 0
    assert terminal.modes() == terminal.modes_before
    assert "the screen failed; the capture goes on with a line per cycle" in terminal.after
    assert re.search(r"cycle   7 .* period .* step .* θ̄", terminal.after)
    accounted(recording)
