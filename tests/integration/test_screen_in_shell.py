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

from tests.command_line import BASE, quick_scenario

pytest.importorskip("pexpect")
pytest.importorskip("pyte")
if sys.platform == "win32":
    pytest.skip("needs a pseudo-terminal", allow_module_level=True)

from host.capture.playback import recorded_actions
from host.virtual_object_process import VirtualObjectProcess
from tests.live_objects import live_object
from tests.terminal_run import Terminal
from tests.waiting import wait_for


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


def gone(pid):
    """Whether a process has ended; nobody may have asked for its exit code yet."""
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] == "Z"


def in_bash(folder, link, recording):
    """Start a capture in an interactive shell; return its terminal and the number of the capture's process."""
    shell = Terminal(["--norc", "--noprofile", "-i"], folder, base=["bash"], PS1="ready> ")
    shell.wait_for("ready>")
    shell.press("stty -a > before\n" + shlex.join([*BASE, "capture", link, "--out", str(recording)]) + "\n")
    shell.wait_for_cycles(2)
    (capture,) = children(shell.process.pid)
    return shell, capture


linux = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks up processes in /proc")
bash = pytest.mark.skipif(shutil.which("bash") is None, reason="needs a shell with job control")


@linux
@bash
def test_a_job_that_was_stopped_is_brought_back_by_fg(tmp_path, virtual):
    """SIGTSTP (Control-Z typed elsewhere) is refused; SIGSTOP cannot be: after ``fg`` all is as before, and counted."""
    recording = tmp_path / "trial.mcap"
    shell, capture = in_bash(tmp_path, virtual.link, recording)
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
    wait_for(recording.with_suffix(".json").exists, "the result")
    shell.press("\nstty -a > after\nexit\n")
    shell.finish()
    assert (tmp_path / "after").read_text() == (tmp_path / "before").read_text()
    losses = accounted(recording)
    # The link's own buffers hold some seconds of samples at this rate; a machine that took longer lost, and counted.
    assert losses["missing"] == 0 or stopped_s > 1.0


@linux
@bash
def test_a_job_in_the_background_leaves_the_terminal_to_the_shell(tmp_path, virtual):
    recording = tmp_path / "trial.mcap"
    shell, capture = in_bash(tmp_path, virtual.link, recording)
    os.killpg(capture, signal.SIGSTOP)
    shell.wait_for("Stopped")
    shell.press("clear; bg; stty -a > meanwhile; echo asleep=$((40+2))\n")
    shell.wait_for("asleep=42")
    size = recording.stat().st_size
    wait_for(lambda: recording.stat().st_size > size + 20_000, "a growing recording")
    shell.press("echo awake=$((42+1))\n")
    seen = shell.wait_for("awake=43")
    assert "rotation drift" not in seen
    assert (tmp_path / "meanwhile").read_text() == (tmp_path / "before").read_text()
    shell.press("fg\n")
    shell.wait_for("rotdrift capture · virtual cube")
    shell.press("m")  # the key is the capture's again
    shell.wait_for("marker 1")
    shell.press("q")
    shell.wait_for("ready>")
    shell.press("exit\n")
    shell.finish()
    assert [action.kind for action in recorded_actions(recording)] == ["marker", "finish"]
    accounted(recording)


@linux
@bash
def test_a_killed_capture_leaves_the_shell_as_it_was(tmp_path, virtual):
    shell, capture = in_bash(tmp_path, virtual.link, tmp_path / "trial.mcap")
    (drawing,) = children(capture)
    seen_before = len(shell.raw)
    os.kill(capture, signal.SIGKILL)
    shell.read_until(lambda: gone(drawing) and "ready> " in shell.raw[seen_before:], "the end of the drawing process")
    shell.wait_for_raw("its recording is kept", 1)
    shell.press("stty -a > after; echo alive=$((40+2))\n")
    seen = shell.wait_for("alive=42")
    assert (tmp_path / "after").read_text() == (tmp_path / "before").read_text()
    assert seen.count("alive=$((40+2))") == 1  # the shell's own line editor is not disturbed: it echoes once
    assert shell.raw.rindex("\x1b[?25h") > shell.raw.rindex("\x1b[?25l")
    shell.press("exit\n")
    shell.finish()


@linux
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGQUIT], ids=["killed", "quit"])
def test_a_script_whose_capture_is_ended_from_outside_has_its_terminal_back(tmp_path, virtual, end):
    """A script's shell restores nothing; that is left to the drawing process, which Control-Backslash reaches too."""
    command = shlex.join([*BASE, "capture", virtual.link, "--out", str(tmp_path / "trial.mcap")])
    script = Terminal(["-c", f"trap : QUIT; ulimit -c 0; {command}; read line"], tmp_path, base=["sh"])
    script.wait_for_cycles(1)
    (capture,) = children(script.process.pid)
    (drawing,) = children(capture)
    assert script.modes() != script.modes_before
    if end == signal.SIGQUIT:
        script.press("\x1c")
    else:
        os.kill(capture, end)
    script.read_until(lambda: gone(drawing), "the end of the drawing process")
    assert script.modes() == script.modes_before
    script.wait_for_raw("its recording is kept", 1)
    assert script.raw.rindex("\x1b[?25h") > script.raw.rindex("\x1b[?25l")
    script.press("\n")
    script.finish()


def test_junk_odd_sizes_and_early_keys_change_nothing(tmp_path):
    """Keys before there is anything, special keys, a paste full of commands, a window dragged to next to nothing."""
    recording = tmp_path / "trial.mcap"
    with VirtualObjectProcess(quick_scenario(tmp_path, lead_in_s=1000.0)) as virtual:  # the hand never begins
        terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path, 120, 36)
        terminal.wait_for("✓ connected")
        terminal.press("f\x1b[A\x1bOP\x1b[<0;5;5M\x1b[200~quit\rsxn\x1b[201~\x00\x07ü☃x")
        terminal.wait_for("no cycle yet")
        for width, height in ((40, 10), (20, 3), (300, 100), (1, 1), (61, 17)):
            terminal.resize(width, height)
            terminal.read()
        terminal.wait_for("cycle")
        terminal.resize(80, 24)
        terminal.wait_for("finish")
        terminal.press("na \x1b[Dnöte ☃\r")  # an arrow key on the way
        terminal.wait_for("a nöte ☃")
        terminal.press("q")
        assert terminal.finish() == 1  # nothing moved: no score
        assert terminal.modes() == terminal.modes_before
        assert "\x1b[?2004h" in terminal.raw
        assert terminal.raw.rindex("\x1b[?2004l") > terminal.raw.rindex("\x1b[?2004h")
    kinds = [(action.kind, action.text) for action in recorded_actions(recording)]
    assert kinds == [("note", "a nöte ☃"), ("finish", "")]
    accounted(recording)


def test_a_closed_window_ends_the_capture_in_order(tmp_path, virtual):
    """A lost ssh connection, a closed window: the recording is closed, the result written, nothing complains."""
    recording = tmp_path / "trial.mcap"
    terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path)
    terminal.wait_for_cycles(4)
    terminal.process.ptyproc.fileobj.close()  # hangs up, as the system does when the window goes
    assert terminal.wait_for_exit() == 0
    result = json.loads(recording.with_suffix(".json").read_text())
    assert result["capture"]["ended"] == "stopped by the operator"
    assert result["theta_bar_deg"] == pytest.approx(0.4, abs=0.01)
    accounted(recording)


def test_a_pulled_cable_is_seen_and_its_return_counted(tmp_path):
    recording = tmp_path / "trial.mcap"
    with live_object(tmp_path, quick_scenario(tmp_path), f"pty:{tmp_path / 'object'}") as virtual:
        terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path)
        terminal.wait_for("✓ connected")
        terminal.wait_for("0 reconnects")
        virtual.fault("unplug for_s=5")
        terminal.wait_for("! DISCONNECTED")
        terminal.wait_for("ALARM link: the link is lost")
        terminal.wait_for("1 reconnect ")
        terminal.wait_for("the link was lost and is open again")
        seen = terminal.wait_for("✓ connected")
        assert "DISCONNECTED" not in seen
        assert "0 reconnects" not in seen
        terminal.press("q")
        terminal.finish()
        assert terminal.modes() == terminal.modes_before
    assert json.loads(recording.with_suffix(".json").read_text())["link"]["reconnects"] == 1


@linux
def test_when_the_drawing_process_dies_the_capture_goes_on_in_lines(tmp_path, virtual):
    recording = tmp_path / "trial.mcap"
    terminal = Terminal(["capture", virtual.link, "--out", recording], tmp_path)
    terminal.wait_for_cycles(2)
    (drawing,) = children(terminal.process.pid)
    os.kill(drawing, signal.SIGKILL)
    terminal.wait_for_raw("the screen failed", 1)
    terminal.wait_for_raw(" period ", terminal.raw.count(" period ") + 3)
    terminal.process.kill(signal.SIGTERM)
    assert terminal.finish() == 0
    assert terminal.modes() == terminal.modes_before
    assert "the screen failed; the capture goes on with a line per cycle" in terminal.after
    assert re.search(r"cycle +\d+ .* period .* step .* θ̄", terminal.after)
    accounted(recording)
