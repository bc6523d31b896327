"""The live screen in a real terminal of 80 x 24: what is seen while it runs, and what is left when it ends."""

import contextlib
import re
import sys
import time

import pytest

from tests.command_line import BASE, environment, quick_scenario

pexpect = pytest.importorskip("pexpect")
pyte = pytest.importorskip("pyte")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs a pseudo-terminal")


class Terminal:
    """A program in a terminal, and what is on its screen."""

    def __init__(self, arguments, cwd, width=80, height=24, **extra):
        self._screen = pyte.Screen(width, height)
        self._stream = pyte.Stream(self._screen)
        self.raw = ""
        self.process = pexpect.spawn(
            BASE[0],
            [*BASE[1:], *map(str, arguments)],
            cwd=str(cwd),
            env=environment(TERM="xterm-256color", **extra),
            dimensions=(height, width),
            encoding="utf-8",
            codec_errors="replace",
            timeout=30,
        )

    def read(self):
        with contextlib.suppress(pexpect.TIMEOUT):
            piece = self.process.read_nonblocking(65536, timeout=0.1)
            self.raw += piece
            self._stream.feed(piece)

    @property
    def text(self):
        return "\n".join(self._screen.display)

    def wait_for(self, text, within_s=30.0):
        deadline = time.monotonic() + within_s
        while text not in self.text:
            assert time.monotonic() < deadline, f"{text!r} was not seen in:\n{self.text}"
            self.read()
        return self.text

    def finish(self):
        with contextlib.suppress(pexpect.EOF):
            while True:
                self.read()
        self.process.wait()
        return self.process.exitstatus


def test_the_demonstration_shows_the_drift_grow_and_gives_the_terminal_back(tmp_path):
    terminal = Terminal(["demo", "--scenario", quick_scenario(tmp_path), "--cycles", 5], tmp_path)
    early = terminal.wait_for("2 of 5 cycles")
    assert "rotation drift θ̄ so far" in early
    assert "virtual cube" in early
    assert "Hz of 200" in early
    assert "none of" in early
    assert "\x1b[?1049h" in terminal.raw
    assert terminal.finish() == 0
    after = terminal.raw.split("\x1b[?1049l")[-1]
    assert "true θ̄ = 0.400°" in after
    assert "rotdrift-trials/" in after
    assert terminal.raw.rindex("\x1b[?25h") > terminal.raw.rindex("\x1b[?25l")


def test_ctrl_c_in_the_terminal_ends_the_demonstration_in_order_without_colour(tmp_path):
    terminal = Terminal(["demo", "--scenario", quick_scenario(tmp_path)], tmp_path, NO_COLOR="1")
    terminal.wait_for("4 of 10 cycles")
    terminal.process.sendintr()
    assert terminal.finish() == 0
    assert "true θ̄ = 0.400°" in terminal.raw
    assert not re.search(r"\x1b\[(\d+;)*(3[0-8]|4[0-8]|9[0-7])(;\d+)*m", terminal.raw)
    assert [path.suffix for path in sorted((tmp_path / "rotdrift-trials").iterdir())] == [".json", ".mcap"]
