"""The Windows console, played: the module as it is loaded there, with small stand-ins for what the system gives."""

import ctypes
import importlib.util
import os
import sys
from types import ModuleType, SimpleNamespace

import pytest

import host.screen.terminal


class Console:
    """Keys that wait, and the console's mode; what is written goes to a file named as the console's device."""

    def __init__(self):
        self.keys = []
        self.mode = 3

    def modules(self):
        msvcrt = ModuleType("msvcrt")
        msvcrt.kbhit = lambda: bool(self.keys)
        msvcrt.getwch = lambda: self.keys.pop(0)
        msvcrt.get_osfhandle = lambda descriptor: 1000 + descriptor
        return msvcrt

    def kernel(self):
        def get_mode(_, reference):
            reference._obj.value = self.mode

        def set_mode(_, mode):
            self.mode = mode

        return SimpleNamespace(GetConsoleMode=get_mode, SetConsoleMode=set_mode)


@pytest.fixture
def windows(monkeypatch, tmp_path):
    """The module as Windows loads it, in a folder in which its console is a file."""
    console = Console()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "msvcrt", console.modules())
    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=console.kernel()), raising=False)
    monkeypatch.setattr(os, "get_terminal_size", lambda _: os.terminal_size((132, 43)))
    spec = importlib.util.spec_from_file_location("terminal_of_windows", host.screen.terminal.__file__)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, console, tmp_path / "CONOUT$"


def test_it_writes_understands_escapes_and_gives_the_console_back(windows):
    module, console, device = windows
    terminal = module.Terminal(1)
    terminal.acquire()
    assert console.mode == 3 | 4  # escape sequences are understood from here on
    assert terminal.size() == (132, 43)
    data = (module.ENTER + "θ̄ = 0.8°").encode()
    assert terminal.write(data) == len(data)
    terminal.release()
    assert console.mode == 3
    assert device.read_bytes() == data
    assert module.in_foreground(1)
    terminal = module.Terminal(1)
    terminal.rescue()
    terminal.release()
    assert device.read_text(encoding="utf-8") == module.LEAVE


def test_keys_come_as_typed_and_special_keys_mean_nothing(windows):
    module, console, _ = windows
    terminal = module.Terminal(1)
    assert terminal.read(0.0) == ""
    console.keys = ["m", "\xe0", "H", "\x00", ";", "ä", "\x1a", "\r"]  # an arrow and F1 are two codes each
    assert terminal.read(0.0) == "mä\x1a\r"
    console.keys = ["\ud83d", "\ude00"]  # one character in two halves
    assert terminal.read(0.0) == "😀"
    assert terminal.in_foreground()
    terminal.release()
