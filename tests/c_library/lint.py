"""``python -m tests.c_library.lint``: the C library through every compiler and checker that is here."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from tests.c_library.build import LIBRARY, SOURCES, WARNINGS, MissingToolError, tool

# Left out: arguments of like types are the nature of a codec; which header declares what is the compiler's matter;
# bytes are promoted to int before every shift, and -Wsign-conversion watches what comes of it.
TIDY = (
    "-*,bugprone-*,cert-*,clang-analyzer-*,misc-*,portability-*,"
    "-bugprone-easily-swappable-parameters,-misc-include-cleaner,-bugprone-signed-bitwise"
)


def _installed(name: str) -> str:
    """Return a program that a package of PyPI brings, or the system's."""
    beside = Path(sys.executable).parent / name
    if beside.exists():
        return str(beside)
    found = shutil.which(name)
    if found is None:
        raise MissingToolError(f"{name} is not installed (pip install 'rotdrift[c]', or the Debian package {name})")
    return found


def _run(*command: object) -> str:
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=200, check=False)
    return done.stdout + done.stderr if done.returncode else ""


def _compile(compiler: str, *flags: str) -> str:
    """Return the warnings of every file, compiled in full: some come from the optimiser."""
    return "".join(_run(compiler, *WARNINGS, "-O2", *flags, "-c", source, "-o", "/dev/null") for source in SOURCES)


def gcc() -> str:
    """Return the warnings of gcc, with its analyser; empty where there are none."""
    return _compile(tool("gcc", "gcc"), "-fanalyzer")


def clang() -> str:
    """Return the warnings of clang."""
    return _compile(tool("clang", "clang"))


def cplusplus() -> str:
    """Return what a C++ compiler has against the headers: sketches of Arduino are C++."""
    headers = sorted(LIBRARY.glob("*.h"))
    return _run(tool("g++", "g++"), "-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", "-x", "c++", *headers)


def cppcheck() -> str:
    """Return the findings of cppcheck."""
    kinds = "--enable=warning,performance,portability"
    return _run(_installed("cppcheck"), kinds, "--std=c99", "--error-exitcode=1", "--quiet", LIBRARY)


def clang_tidy() -> str:
    """Return the findings of clang-tidy."""
    checks = (f"--checks={TIDY}", "--warnings-as-errors=*", "--quiet")
    return _run(_installed("clang-tidy"), *checks, *SOURCES, "--", "-std=c99")


CHECKS: dict[str, Callable[[], str]] = {
    "gcc": gcc,
    "clang": clang,
    "C++ headers": cplusplus,
    "cppcheck": cppcheck,
    "clang-tidy": clang_tidy,
}


def main() -> int:
    """Print what each finds; 1 where one finds anything."""
    found = 0
    for name, check in CHECKS.items():
        try:
            findings = check()
        except MissingToolError as error:
            print(f"{name}: left out, {error}")
            continue
        found += bool(findings)
        print(f"{name}: {findings.strip() or 'clean'}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
