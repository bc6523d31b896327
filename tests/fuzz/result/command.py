"""The command line of the structure-aware fuzzer."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from random import Random

from tests.fuzz.result import campaign
from tests.fuzz.result.bounds import limit_memory, limited_time
from tests.fuzz.result.targets import TARGETS

PURPOSE = "Structure-aware inputs, sent all the way to the result file."


def main() -> int:
    """Try inputs as the command line asks; return 1 where any was a find."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz.result", description=PURPOSE)
    parser.add_argument("targets", nargs="*", choices=[*TARGETS, []], help="default: all")
    parser.add_argument("--inputs", type=int, default=500, help="how many of each target")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, metavar="NUMBER", help="try this input alone")
    parser.add_argument("--state", type=Path, metavar="FILE", help="a long run of one target: go on as it says")
    parser.add_argument("--slices", type=int, default=1, help="with --state: how many, then end")
    parser.add_argument("--slice", type=int, default=500, help="inputs between two states in the file")
    parser.add_argument(
        "--processor-s", type=float, default=float("inf"), help="with --state: end after so much in all"
    )
    args = parser.parse_args()
    names = args.targets or list(TARGETS)
    limit_memory()
    if args.only is not None:
        with limited_time():
            TARGETS[names[0]](Random(f"{names[0]} {args.seed} {args.only}"))
        return 0
    if args.state is not None:
        return _long(names[0], args)
    runs = [campaign.Run(name, args.seed, campaign.commit_here()) for name in names]
    for run in runs:
        run.try_inputs(TARGETS[run.target], args.inputs)
        _report(run)
    return 1 if any(run.finds for run in runs) else 0


def _long(name: str, args: argparse.Namespace) -> int:
    """Go on with a long run, slice by slice."""
    commit = campaign.commit_here()
    run = campaign.load(args.state) if args.state.exists() else campaign.Run(name, args.seed, commit)
    if (run.target, run.commit) != (name, commit):
        sys.exit(f"{args.state} is a run of {run.target} at {run.commit}, not of {name} at {commit}: name another file")
    for _ in range(args.slices):
        if run.processor_s >= args.processor_s:
            break
        run.try_inputs(TARGETS[name], args.slice)
        run.save(args.state)
        print(run.line(), flush=True)
    _report(run)
    return 1 if run.finds else 0


def _report(run: campaign.Run) -> None:
    print(run.line(), flush=True)
    for key, find in sorted(run.finds.items()):
        print(f"  {key}: {find.inputs} inputs, {find.examples} ...: {find.what!a}", flush=True)
