"""``python -m tests.c_library.fuzz --runs 1000000``: libFuzzer on the C library, from the seeds of tests.fuzz."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.c_library.build import HERE, WARNINGS, MissingToolError, compiled, tool
from tests.fuzz.mutation import SEEDS

FLAGS = (*WARNINGS, "-g", "-O1", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all")


def fuzzer() -> Path:
    """Return the fuzzing program.

    Raises
    ------
    MissingToolError
        No clang, or no libFuzzer.
    """
    clang = tool("clang", "clang")
    where = subprocess.run(
        [clang, "-print-resource-dir"], capture_output=True, text=True, check=True, timeout=60
    ).stdout.strip()
    if not list(Path(where).glob("lib/**/libclang_rt.fuzzer*")):
        raise MissingToolError("libFuzzer is not installed (Debian package libclang-rt-14-dev)")
    return compiled(clang, [HERE / "fuzz_receiver.c"], FLAGS)


def run(runs: int, seed: int = 1) -> subprocess.CompletedProcess[str]:
    """Return the finished run of so many inputs; its exit status is 0 where nothing was found."""
    with tempfile.TemporaryDirectory() as corpus:
        limits = [f"-runs={runs}", f"-seed={seed}", "-timeout=5", "-max_len=4096", "-print_final_stats=1"]
        command = [fuzzer(), *limits, f"-artifact_prefix={Path.cwd()}/", corpus, SEEDS / "stream", SEEDS / "can"]
        return subprocess.run(command, capture_output=True, text=True, timeout=3600, check=False)


def main() -> int:
    """Run; not 0 where an input breaks the library: it is kept as ``crash-*``."""
    parser = argparse.ArgumentParser(prog="python -m tests.c_library.fuzz", description=__doc__)
    parser.add_argument("--runs", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    try:
        done = run(args.runs, args.seed)
    except MissingToolError as error:
        print(f"C library: {error}, so no guided run", file=sys.stderr)
        return 0
    print(*done.stderr.splitlines()[-12:], sep="\n")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
