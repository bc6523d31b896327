"""``python -m tests.c_library.budgets``: code, static data and stack of the C library on a Cortex-M0+."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from tests.c_library.build import LIBRARY, SOURCES, WARNINGS, MissingToolError, tool

FLAGS = ("-mcpu=cortex-m0plus", "-mthumb", "-Os", "-ffreestanding", "-fstack-usage", "-fcallgraph-info=su")
MAX_CORE_BYTES = 2048
"""Code and constants of ``rotdrift_protocol.c``; the compiler's soft float is not counted."""
MAX_STACK_BYTES = 128
"""Stack of any one function."""


@dataclass(frozen=True)
class Part:
    """Code, data and stack of one file of the library."""

    name: str
    code_bytes: int
    """Instructions and constants."""
    static_bytes: int
    """Variables."""
    frames: dict[str, int]
    """Stack of each function by itself, bytes."""
    chains: dict[str, int]
    """Stack of each function with what it calls within the library, at the deepest."""
    needs: frozenset[str]
    """Symbols it needs from elsewhere."""


def _graph(text: str) -> tuple[dict[str, int], dict[str, set[str]]]:
    """Return the stack of the functions, and the calls, of a call graph of gcc's (``-fcallgraph-info=su``)."""
    frames = {
        name: int(size) for name, size in re.findall(r'node: { title: "([^"]+)" label: "[^"]*\\n(\d+) bytes', text)
    }
    calls: dict[str, set[str]] = {}
    for caller, callee in re.findall(r'edge: { sourcename: "([^"]+)" targetname: "([^"]+)"', text):
        calls.setdefault(caller, set()).add(callee)
    return frames, calls


def measure() -> list[Part]:
    """Compile every file of the library for a Cortex-M0+ and measure it.

    Raises
    ------
    MissingToolError
        No cross compiler.
    """
    package = "gcc-arm-none-eabi"
    gcc, size, nm = (tool(f"arm-none-eabi-{name}", package) for name in ("gcc", "size", "nm"))
    frames: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for source in SOURCES:
            made = folder / f"{source.stem}.o"
            subprocess.run([gcc, *WARNINGS, *FLAGS, "-I", LIBRARY, "-c", source, "-o", made], check=True, timeout=60)
            row = subprocess.run(
                [size, made], capture_output=True, text=True, check=True, timeout=60
            ).stdout.splitlines()[1]
            undefined = subprocess.run(
                [nm, "-u", made], capture_output=True, text=True, check=True, timeout=60
            ).stdout.split()
            own, edges = _graph(made.with_suffix(".ci").read_text())
            frames |= own
            for caller, callees in edges.items():
                calls.setdefault(caller, set()).update(callees)
            code, data, bss = map(int, row.split()[:3])
            found.append((source.stem, code, data + bss, own, frozenset(undefined) - {"U"}))

    def deepest(function: str) -> int:
        return frames.get(function, 0) + max((deepest(callee) for callee in calls.get(function, ())), default=0)

    return [
        Part(name, code, static, own, {function: deepest(function) for function in own}, needs)
        for name, code, static, own, needs in found
    ]


def main() -> int:
    """Print a table; 1 where a budget is not kept."""
    try:
        parts = measure()
    except MissingToolError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"{'file':20} {'code':>6} {'static':>6}  largest stack of a function         with what it calls here")
    for part in parts:
        frame, chain = (max(stacks, key=lambda name: stacks[name]) for stacks in (part.frames, part.chains))
        own, deep = (
            f"{stacks[name]} {name.split(':')[-1]}" for stacks, name in ((part.frames, frame), (part.chains, chain))
        )
        print(f"{part.name:20} {part.code_bytes:6} {part.static_bytes:6}  {own:35} {deep}")
    print("bytes; gcc -Os, Cortex-M0+, soft float and memcpy not counted")
    needs = sorted(set().union(*(part.needs for part in parts)))
    print("needs:", " ".join(name for name in needs if not name.startswith("rd_")))
    core = next(part for part in parts if part.name == "rotdrift_protocol")
    kept = core.code_bytes <= MAX_CORE_BYTES and not any(part.static_bytes for part in parts)
    kept = kept and all(max(part.frames.values()) <= MAX_STACK_BYTES for part in parts)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
