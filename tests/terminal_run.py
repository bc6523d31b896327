"""The command in a real terminal: what is on its screen, keys pressed, modes left behind."""

import contextlib
import re
import termios

import pexpect
import pyte

from tests.command_line import BASE, environment
from tests.waiting import HANG_S, wait_for

_CYCLES = re.compile(r"(\d+)(?: of \d+)? cycles?\b.*\d\d:\d\d")  # with the time beside it, as the dashboard has


class Terminal:
    """A program in a terminal, and what is on its screen: the command, or what ``base`` names."""

    def __init__(self, arguments, cwd, width=80, height=24, base=BASE, **extra):
        program = [*base, *map(str, arguments)]
        self._screen = pyte.Screen(width, height)
        self._stream = pyte.Stream(self._screen)
        self.raw = ""
        self.process = pexpect.spawn(
            program[0],
            program[1:],
            cwd=str(cwd),
            env=environment(TERM="xterm-256color", **extra),
            dimensions=(height, width),
            encoding="utf-8",
            codec_errors="replace",
            timeout=HANG_S,
        )
        self.process.delaybeforesend = None
        self.modes_before = self.modes()

    def modes(self):
        """Return the modes of the terminal that a program must restore."""
        mode = termios.tcgetattr(self.process.child_fd)
        return mode[:4]

    def read(self):
        with contextlib.suppress(pexpect.TIMEOUT):
            piece = self.process.read_nonblocking(65536, timeout=0.1)
            self.raw += piece
            self._stream.feed(piece)

    @property
    def text(self):
        return "\n".join(self._screen.display)

    def read_until(self, condition, what):
        """Follow what the program writes until a condition holds; return what is on the screen then."""
        wait_for(condition, lambda: f"{what} in:\n{self.text}", self.read)
        return self.text

    def wait_for(self, text):
        return self.read_until(lambda: text in self.text, repr(text))

    def wait_for_raw(self, text, count):
        """Wait until so many of a sequence were written: what has left the screen counts as well."""
        return self.read_until(lambda: self.raw.count(text) >= count, f"{count} of {text!r}, written but not kept,")

    def wait_for_cycles(self, count):
        """Wait until the screen counts so many cycles, or more: one that is busy elsewhere skips pictures."""
        return self.read_until(
            lambda: any(int(shown) >= count for shown in _CYCLES.findall(self.text)), f"{count} cycles"
        )

    def resize(self, width, height):
        """Give the window another size, as dragging its corner does."""
        self.process.setwinsize(height, width)
        self._screen.resize(height, width)

    def press(self, keys):
        self.process.send(keys)

    def finish(self):
        """Follow it to its end; return its exit code."""
        with contextlib.suppress(pexpect.EOF):
            self.read_until(lambda: False, "the end of the program")
        return self.wait_for_exit()

    def wait_for_exit(self):
        """Wait until it has ended, without reading what it writes; return its exit code."""
        wait_for(lambda: not self.process.isalive(), "the exit of the program")
        return self.process.exitstatus

    @property
    def after(self):
        """What was written after the screen was left."""
        return self.raw.split("\x1b[?1049l")[-1]
