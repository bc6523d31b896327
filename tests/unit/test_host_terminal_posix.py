"""The modes of a POSIX terminal: taken, and given back to whom they belong."""

import os
import sys

import pytest

if sys.platform == "win32":
    pytest.skip("needs a pseudo-terminal", allow_module_level=True)

import pty
import termios

from host.screen.terminal import Terminal, TerminalLostError
from tests.waiting import wait_for


@pytest.fixture
def device():
    """A terminal that belongs to nobody's session: its own end, and the program's."""
    window, program = pty.openpty()
    yield window, program
    os.close(program)
    os.close(window)


def test_keys_come_one_by_one_until_it_is_given_back(device):
    window, program = device
    before = termios.tcgetattr(program)
    terminal = Terminal(program)
    terminal.acquire()
    local = termios.tcgetattr(program)[3]
    assert not local & (termios.ICANON | termios.ECHO)
    assert local & termios.ISIG  # Control-C stays what it is
    terminal.acquire()  # once more, as after the process was stopped
    terminal.release()
    assert termios.tcgetattr(program) == before
    del window


def test_modes_that_a_shell_has_set_meanwhile_are_the_shell_s(device):
    _, program = device
    terminal = Terminal(program)
    terminal.acquire()
    its_own = termios.tcgetattr(program)
    its_own[3] |= termios.ECHO
    termios.tcsetattr(program, termios.TCSANOW, its_own)
    its_own = termios.tcgetattr(program)
    terminal.release()
    assert termios.tcgetattr(program) == its_own


def test_a_terminal_that_takes_nothing_is_not_waited_for(device):
    _, program = device
    terminal = Terminal(program)
    terminal.acquire()
    wait_for(lambda: not terminal.write(b"x" * 10_000), "a full buffer, for nobody reads")
    terminal.release()


def test_a_terminal_that_is_gone_says_so():
    window, program = pty.openpty()
    terminal = Terminal(program)
    os.close(window)
    for use in (
        terminal.acquire,
        terminal.size,
        terminal.in_foreground,
        lambda: terminal.write(b"x"),
        lambda: terminal.read(0.0),
    ):
        with pytest.raises(TerminalLostError):
            use()
    os.close(program)
