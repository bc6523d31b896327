"""Programs of the C library: built for this machine or for an emulated Cortex-M, asked lines and answering lines."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from tests.waiting import HANG_S

LIBRARY = Path(__file__).resolve().parents[2] / "firmware_protocol" / "c"
HERE = Path(__file__).resolve().parent
SOURCES = tuple(sorted(LIBRARY.glob("*.c")))
WARNINGS = (
    *("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Wdouble-promotion"),
    *("-Wshadow", "-Wcast-align", "-Wcast-qual", "-Wstrict-prototypes", "-Wundef", "-Werror"),
)
"""What the library must compile with, by every compiler."""
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
CORES = {
    "mps2-an385": ("-mcpu=cortex-m0plus",),
    "mps2-an386": ("-mcpu=cortex-m4", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"),
}
"""Emulated boards, and the code they run: soft float of the smallest core, hardware float of a larger one."""


class MissingToolError(Exception):
    """A program that the build or the run needs is not on this machine; the message names it and its package."""


def tool(name: str, package: str) -> str:
    """Return the path of a program.

    Raises
    ------
    MissingToolError
        It is not installed.
    """
    path = shutil.which(name)
    if path is None:
        raise MissingToolError(f"{name} is not installed (Debian package {package})")
    return path


def compiled(compiler: str, sources: Iterable[Path], flags: Iterable[str]) -> Path:
    """Return a program made of the library and some sources, compiled where that was not done before."""
    files = [*SOURCES, *sources]
    inputs = b"".join(path.read_bytes() for path in [*files, *sorted(LIBRARY.glob("*.h")), *HERE.glob("*.ld")])
    digest = hashlib.sha256(inputs + repr((compiler, *flags)).encode()).hexdigest()[:16]
    program = Path(tempfile.gettempdir()) / f"rotdrift-c-{files[-1].stem}-{digest}"
    if not program.exists():
        with tempfile.TemporaryDirectory(dir=program.parent) as folder:
            made = Path(folder) / "program"
            command = [compiler, *flags, "-I", LIBRARY, *files, "-o", made]
            subprocess.run(command, check=True, timeout=HANG_S)
            made.replace(program)  # whole or not at all, also when two build it
    return program


@dataclass(frozen=True)
class Driver:
    """``driver.c``, compiled: a filter of lines."""

    command: tuple[str, ...]
    """Arguments before the two files; with an emulator, what stands between them."""
    is_emulated: bool = False

    def ask(self, lines: Iterable[str]) -> list[str]:
        """Return the answers to questions, one for each."""
        with tempfile.TemporaryDirectory() as folder:
            questions, answers = Path(folder) / "questions", Path(folder) / "answers"
            text = "".join(f"{line}\n" for line in lines)
            questions.write_text(text, encoding="ascii")
            files = [str(questions), str(answers)]
            if self.is_emulated:
                arguments = ",".join(f"arg={argument}" for argument in ("driver", *files))
                files = ["-semihosting-config", f"enable=on,target=native,{arguments}"]
            done = subprocess.run(
                [*self.command, *files],
                capture_output=True,
                text=True,
                timeout=HANG_S,
                env={**os.environ, "LC_ALL": "C"},
            )
            if done.returncode:
                raise AssertionError(f"the C program ended with {done.returncode}: {done.stderr[-4000:]}")
            return answers.read_text(encoding="ascii").splitlines()


def host_driver() -> Driver:
    """Return the driver for this machine, with the address and undefined-behaviour sanitizers.

    Raises
    ------
    MissingToolError
        No C compiler.
    """
    return Driver((str(compiled(tool("gcc", "gcc"), [HERE / "driver.c"], (*WARNINGS, *SANITIZERS))),))


def target_driver(board: str) -> Driver:
    """Return the driver for an emulated board.

    Raises
    ------
    MissingToolError
        No cross compiler, or no emulator.
    """
    emulator = tool("qemu-system-arm", "qemu-system-arm")
    flags = (*WARNINGS, *CORES[board], "-mthumb", "-Os", "--specs=rdimon.specs", "-T", str(HERE / "mps2.ld"))
    sources = [HERE / "vectors.c", HERE / "driver.c"]
    try:
        image = compiled(tool("arm-none-eabi-gcc", "gcc-arm-none-eabi"), sources, flags)
    except subprocess.CalledProcessError:
        if not list(Path("/usr/lib/arm-none-eabi").glob("**/rdimon.specs")):
            raise MissingToolError("newlib is not installed (Debian package libnewlib-arm-none-eabi)") from None
        raise
    quiet = ("-display", "none", "-monitor", "none", "-serial", "null")
    return Driver((emulator, "-M", board, *quiet, "-kernel", str(image)), is_emulated=True)
