"""Nothing prints but ``host.output``: no ``print``, no standard stream, no console of rich anywhere else."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    ROOT / "rotdrift.py",
    *sorted(
        path
        for package in ("analysis", "emulator", "firmware_protocol", "host")
        for path in (ROOT / package).rglob("*.py")
        if path.parent != ROOT / "host" / "output"
    ),
]
STREAMS = {"stdout", "stderr", "__stdout__", "__stderr__", "displayhook", "excepthook", "unraisablehook"}
CALLS = {
    *("print", "input", "breakpoint", "pprint", "pp", "print_exc", "print_exception", "print_tb", "print_stack"),
    *("print_help", "print_usage", "Console", "FileProxy", "StreamHandler", "basicConfig", "showwarning", "getpass"),
}
"""Whatever prints by itself, by any name that it can be imported by."""
RICH = {"rich.console.Console", "rich.print", "rich.progress.track", "rich.prompt", "rich.logging"}
NOT_A_TERMINAL = {
    "host/screen/process.py": {"sys.stdout"},  # a pipe to the capture, which has started this process
    "firmware_protocol/can/dbc.py": {"sys.stdout"},  # a file made from our own constants: nothing foreign is in it
    "rotdrift.py": {"print", "sys.stderr"},  # our packages are hidden: it cleans the text itself
}
OURS = ("console.print", "open_console().print", "open_console(width=max(console.width, wide)).print")
"""Prints of consoles that ``host.output.drawings`` has made."""


def found_in(source):
    """Everything in a source that prints past the door."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "sys":
            found |= {f"sys.{node.attr}"} & {f"sys.{name}" for name in STREAMS}
        elif isinstance(node, ast.ImportFrom) and node.module == "sys":
            found |= {f"sys.{alias.name}" for alias in node.names if alias.name in STREAMS}
        elif isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "rich":
            names = {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
            found |= names & (RICH - {"rich.console.Console"})  # its name is needed for annotations
        elif isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            whole = ast.unparse(node.func)
            if name in CALLS and whole not in OURS:
                found.add(whole)
            if whole == "os.write" and node.args and ast.unparse(node.args[0]) in {"1", "2"}:
                found.add("os.write")
            if name == "Progress" and "console" not in {word.arg for word in node.keywords}:
                found.add("Progress without a console")
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_nothing_prints_past_the_door(path):
    name = path.relative_to(ROOT).as_posix()
    assert found_in(path.read_text(encoding="utf-8")) <= NOT_A_TERMINAL.get(name, set()), "print with host.output"


@pytest.mark.parametrize(
    ("source", "printing"),
    [
        ("print('x')", {"print"}),
        ("input('x')", {"input"}),
        ("import sys; sys.stdout.write('x')", {"sys.stdout"}),
        ("from sys import stderr", {"sys.stderr"}),
        ("sys.__stderr__.write('x')", {"sys.__stderr__"}),
        ("questions(input, sys.stdout)", {"sys.stdout"}),
        ("from rich.console import Console\nConsole().print('x')", {"Console", "Console().print"}),
        ("from rich.progress import track", {"rich.progress.track"}),
        ("Progress()", {"Progress without a console"}),
        ("Progress(console=console)", set()),
        ("traceback.print_exc()", {"traceback.print_exc"}),
        ("parser.print_help()", {"parser.print_help"}),
        ("os.write(2, b'x')", {"os.write"}),
        ("os.write(self._fd, b'x')", set()),
        ("open_console().print('x')", set()),
        ("console.print('x')", set()),
        ("write_line('x')", set()),
    ],
)
def test_what_prints_is_found(source, printing):
    assert found_in(source) == printing


def test_the_exceptions_are_needed():
    for name, allowed in NOT_A_TERMINAL.items():
        assert found_in((ROOT / name).read_text(encoding="utf-8")) == allowed, name
