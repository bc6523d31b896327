"""Boots the user-mode kernel as an ordinary process, with this machine's files, to run one of our modules in it."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tests.waiting import HANG_S

UML = Path(__file__).resolve().parent
MODULES = Path("/usr/lib/uml/modules")


def missing(programs: Sequence[str], module: str) -> str | None:
    """Why the kernel cannot run here: a program or a kernel module that is not installed."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return "user-mode Linux is there for Linux on x86-64 only"
    if not list(MODULES.glob(f"*/kernel/**/{module}.ko")):
        return "the user-mode kernel is not installed: tests/system-packages.sh"
    path = "/usr/sbin:/sbin:" + os.environ.get("PATH", "")
    for program in ("linux.uml", *programs):
        if shutil.which(program, path=path) is None:
            return f"{program} is not installed: tests/system-packages.sh"
    if "amx_tile" in Path("/proc/cpuinfo").read_text() and shutil.which("gcc") is None:
        return "on processors with AMX the user-mode kernel needs a small library, and there is no gcc to make it"
    return None


def boot(module: str, work: Path, limit_s: float, *options: str) -> str:
    """Run ``python -m module`` as the only program of a kernel, to its end; return what it printed."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST")}
    if "amx_tile" in Path("/proc/cpuinfo").read_text():
        library = work / "full_xstate.so"
        command = ["gcc", "-O2", "-shared", "-fPIC", "-o", str(library), str(UML / "full_xstate.c"), "-ldl"]
        subprocess.run(command, check=True, timeout=HANG_S)
        environment["LD_PRELOAD"] = str(library)
    kernel = ["linux.uml", "mem=768M", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", "quiet", *options]
    consoles = ["con=null", "con0=null,fd:1", "con1=null"]
    guest = [f"init={UML / 'init.sh'}", f"UML_REPOSITORY={UML.parents[1]}", f"UML_PYTHON={sys.executable}"]
    output = work / "console.txt"
    with output.open("wb") as file:
        process = subprocess.Popen(
            [*kernel, *consoles, *guest, f"UML_MODULE={module}"],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )
        try:
            process.wait(limit_s)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, 9)
                process.wait(HANG_S)
    return output.read_text(errors="replace")
