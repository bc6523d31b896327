"""The suite cannot hang, and does not care how it was started."""

import ast
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.can_traffic import info_packet, object_at
from tests.waiting import HANG_S, wait_for

TESTS = Path(__file__).parents[1]
WAITS = {"communicate", "join", "wait"}
RUNS = {"call", "check_call", "check_output", "run"}
READS = {"readline", "readlines"}
"""Whatever reads from a pipe up to the end of a line blocks, however the loop around it is bounded."""


def unbounded(call):
    """Return whether a call may block for ever."""
    if not isinstance(call.func, ast.Attribute):
        return False
    bounded = any(word.arg in {"timeout", None} for word in call.keywords)
    if call.func.attr in RUNS and ast.unparse(call.func.value) == "subprocess":
        return not bounded
    return (call.func.attr in WAITS and not call.args and not bounded) or call.func.attr in READS


def test_no_wait_is_without_a_bound():
    found = [
        f"{path.relative_to(TESTS)}:{node.lineno}: {ast.unparse(node)}"
        for path in TESTS.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and unbounded(node)
    ]
    assert found == [], "see tests/waiting.py and tests/command_line.py"


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("subprocess.run(command, check=True)", True),
        ("subprocess.run(command, timeout=HANG_S)", False),
        ("process.wait()", True),
        ("process.wait(HANG_S)", False),
        ("process.communicate(timeout=HANG_S)", False),
        ("process.stdout.readline()", True),
        ("', '.join(words)", False),
    ],
)
def test_a_wait_without_a_bound_is_found(code, expected):
    assert unbounded(ast.parse(code, mode="eval").body) == expected


def test_a_wait_ends_with_a_message_before_the_test_does_and_the_test_before_its_process(pytestconfig, monkeypatch):
    assert HANG_S < float(pytestconfig.getini("timeout")) < float(pytestconfig.getini("faulthandler_timeout"))
    assert pytestconfig.getini("faulthandler_exit_on_timeout")
    monkeypatch.setattr("tests.waiting.HANG_S", 0.02)
    with pytest.raises(AssertionError, match=r"waited 0 s for the end of the world"):
        wait_for(lambda: False, "the end of the world")


def test_what_an_object_on_can_sends_does_not_depend_on_how_busy_the_machine_is(monkeypatch):
    end = object_at()  # its INFO waits for flow control, for so long on the machine's clock
    later_ns = time.perf_counter_ns() + 10**10
    monkeypatch.setattr("isotp.tools.time", SimpleNamespace(perf_counter_ns=lambda: later_ns))
    assert end.encode([info_packet()]) == []


def test_programs_under_test_ignore_no_signal():
    names = [name for name in ("SIGHUP", "SIGINT", "SIGQUIT") if hasattr(signal, name)]
    code = f"import signal as s; print([name for name in {names} if s.getsignal(s.Signals[name]) is s.SIG_IGN])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=HANG_S)
    assert done.stdout == "[]\n"


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")
def test_nor_where_the_suite_runs_in_the_background_of_a_shell_that_is_left_and_has_no_input():
    in_background = ["sh", "-c", 'trap "" HUP INT QUIT; exec "$@" <&-', "sh"]
    test = f"{__file__}::{test_programs_under_test_ignore_no_signal.__name__}"
    done = subprocess.run(
        [*in_background, sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", test],
        cwd=TESTS.parent,
        capture_output=True,
        text=True,
        check=False,
        timeout=HANG_S,
    )
    assert done.returncode == 0, done.stdout
