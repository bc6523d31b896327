"""Real SocketCAN: a user-mode kernel with CAN boots as an ordinary process, and our links are checked inside it.

What is checked stands in ``tests/uml/guest_checks.py``; ``tests/system-packages.sh`` installs what it needs.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import HANG_S

UML = Path(__file__).resolve().parents[1] / "uml"
CHECKS = [
    "vcan_classic",
    "vcan_fd",
    "kernel_slcan_against_our_adapter",
    "the_same_trial_by_capture_candump_and_canplayer",
    "link_down_and_up_during_a_capture",
    "two_objects_on_one_bus_are_captured_at_once",
    "error_frames_of_the_kernel_are_told",
    "filters_are_in_the_kernel",
    "an_interface_that_is_pulled_and_comes_back_is_opened_again",
    "interfaces_that_are_missing_or_down_are_told_at_once",
    "ports_lists_the_interfaces",
]
LIMIT_S = 480


def missing() -> str | None:
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return "user-mode Linux is there for Linux on x86-64 only"
    if not list(Path("/usr/lib/uml/modules").glob("*/kernel/drivers/net/can/vcan.ko")):
        return "the user-mode kernel is not installed: tests/system-packages.sh"
    path = "/usr/sbin:/sbin:" + os.environ.get("PATH", "")
    for program in ("linux.uml", "candump", "canplayer", "slcand", "ip"):
        if shutil.which(program, path=path) is None:
            return f"{program} is not installed: tests/system-packages.sh"
    if "amx_tile" in Path("/proc/cpuinfo").read_text() and shutil.which("gcc") is None:
        return "on processors with AMX the user-mode kernel needs a small library, and there is no gcc to make it"
    return None


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What the guest printed."""
    reason = missing()
    if reason:
        pytest.skip(reason)
    work = tmp_path_factory.mktemp("uml")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    if "amx_tile" in Path("/proc/cpuinfo").read_text():
        library = work / "full_xstate.so"
        command = ["gcc", "-O2", "-shared", "-fPIC", "-o", str(library), str(UML / "full_xstate.c"), "-ldl"]
        subprocess.run(command, check=True, timeout=HANG_S)
        environment["LD_PRELOAD"] = str(library)
    kernel = ["linux.uml", "mem=768M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", "quiet"]
    consoles = ["con=null", "con0=null,fd:1", "con1=null"]
    guest = [f"init={UML / 'init.sh'}", f"UML_REPOSITORY={UML.parents[1]}", f"UML_PYTHON={sys.executable}"]
    output = work / "console.txt"
    with output.open("wb") as file:
        process = subprocess.Popen(
            [*kernel, *consoles, *guest],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )
        try:
            process.wait(LIMIT_S)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, 9)
                process.wait(HANG_S)
    text = output.read_text(errors="replace")
    if "CHECK" not in text:
        pytest.skip(f"the user-mode kernel does not run here: {text.strip().splitlines()[-1:]}")
    return text


@pytest.mark.parametrize("check", CHECKS)
def test_real_socketcan(check: str, said: str) -> None:
    assert f"CHECK {check} ok" in said, said[-4000:]
