"""``python -m benchmarks``: measure every topic, write a table (Markdown and JSON) and a plot."""

from __future__ import annotations

# ruff: noqa: E402
import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"  # before numpy is imported: figures are for one core

import argparse
import importlib
import json
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.measurement import Topic
from benchmarks.report import machine, markdown, plot

TOPICS = (
    "decode",
    "rotations",
    "scoring",
    "start_up",
    "recording",
    "recovery",
    "can_decode",
    "can_throughput",
    "live",
    "eight_objects",
    "dashboard_cost",
    "reaction_times",
    "growth",
)
"""Modules with ``measure(quick) -> Topic``, in the order of the table."""
QUICK = ("decode", "rotations", "recording", "live", "start_up", "can_decode", "scoring", "growth")
"""Those of ``--quick``, what decides most first: on a slow machine the last are left out."""
QUICK_S = 40.0
"""After so long ``--quick`` begins no other topic, so that it ends within a minute."""


def main(arguments: list[str] | None = None) -> int:
    """Run; 0 also where goals are missed: figures inform, tests judge."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the decisive ratios only, within a minute")
    parser.add_argument("--only", nargs="+", choices=TOPICS, metavar="TOPIC", help=", ".join(TOPICS))
    parser.add_argument("--out", type=Path, default=Path("build/benchmarks"), help="folder for table and plot")
    args = parser.parse_args(arguments)
    topics: list[Topic] = []
    started = time.monotonic()
    facts: dict[str, Any] = machine()
    for name in args.only or (QUICK if args.quick else TOPICS):
        before = time.monotonic()
        if args.quick and before - started > QUICK_S:
            print(f"{name}: left out, this machine is slow or busy", flush=True)
            continue
        topic: Topic = importlib.import_module(f"benchmarks.{name}").measure(args.quick)
        topics.append(topic)
        print(markdown([topic]), flush=True)
        print(f"({name}: {time.monotonic() - before:.0f} s)\n", file=sys.stderr)
    facts["load after"] = " ".join(f"{value:.1f}" for value in os.getloadavg())
    facts["took"] = f"{time.monotonic() - started:.0f} s"
    args.out.mkdir(parents=True, exist_ok=True)
    document = {
        "machine": facts,
        "topics": [
            {"title": topic.title, "rows": [row.plain() for row in topic.rows], "left_out": topic.left_out}
            for topic in topics
        ],
    }
    (args.out / "table.json").write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n")
    (args.out / "table.md").write_text(markdown(topics, facts))
    plot(topics, args.out / "plot.png")
    print(f"written to {args.out}: table.md, table.json, plot.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
