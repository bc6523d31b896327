"""``python -m tests.fuzz``: throw inputs at the targets, with atheris where it is installed, else by plain mutation.

python -m tests.fuzz                          every target, 20 000 inputs each
python -m tests.fuzz stream --runs 1000000    one target
python -m tests.fuzz stream --atheris -- -max_total_time=60
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from tests.fuzz.memory import LIMIT_BYTES, limit_memory
from tests.fuzz.mutation import SEEDS, mutated
from tests.fuzz.targets import TARGETS

SLOW_S = {"commands": 40.0}
"""Longest that an input may take, s; 2 for all others. A command reads some files in processes, for up to 20 s."""
DEAR = {"commands": 40}
"""Targets of which one input costs as much as so many of the others."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__.splitlines()[0])
    parser.add_argument("targets", nargs="*", choices=[*TARGETS, []], help="default: all")
    parser.add_argument("--runs", type=int, default=20_000, help="inputs for each target; fewer of `commands`")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--atheris", action="store_true", help="coverage-guided; one target; options after --")
    args, rest = parser.parse_known_args()
    names = args.targets or list(TARGETS)
    if args.atheris:
        return guided(names[0], [option for option in rest if option != "--"], args.runs)
    limit_memory()
    for name in names:
        runs = max(args.runs // DEAR.get(name, 1), 1)
        started, slowest = time.monotonic(), 0.0
        for number, data in enumerate(mutated(name, runs, args.seed)):
            before = time.monotonic()
            try:
                TARGETS[name](data)
            except Exception:
                path = Path(f"crash-{name}-{args.seed}-{number}")
                path.write_bytes(data)
                print(f"{name}: input {number} fails, kept as {path}", file=sys.stderr)
                raise
            slowest = max(slowest, time.monotonic() - before)
        seconds = time.monotonic() - started
        print(f"{name}: {runs} inputs clean in {seconds:.1f} s, the slowest {1e3 * slowest:.1f} ms", flush=True)
        if slowest > SLOW_S.get(name, 2.0):
            print(f"{name}: an input took {slowest:.1f} s", file=sys.stderr)
            return 1
    return 0


def guided(name: str, options: list[str], runs: int) -> int:
    """Let atheris find its own way, from the committed seeds; it never returns when it has found something."""
    try:
        import atheris
    except ModuleNotFoundError:
        print(f"{name}: atheris is not installed here, so no guided run", file=sys.stderr)
        return 0
    limits = [f"-runs={runs}", "-timeout=5", f"-rss_limit_mb={LIMIT_BYTES // 2**20}", "-max_len=16384"]
    atheris.instrument_all()
    # What is found on the way goes into the first folder; the committed seeds are only read.
    corpus = Path(".fuzz") / name
    corpus.mkdir(parents=True, exist_ok=True)
    atheris.Setup([sys.argv[0], *limits, *options, str(corpus), str(SEEDS / name)], TARGETS[name])
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())
