"""A gap anywhere in any shipped scenario, through the whole live path: nothing may fail, and the ledger must sum up.

``python -m benchmarks.gaps [--every 0.1] [--cycles 4] [SCENARIO ...]``: for each scenario, a gap of 0.2, 0.6 and 2 s at
every tenth of a second, in turns lost on the link and as a link that was opened again. The exit code is 1 where a part
of the live view failed, or where produced is not received + lost + rejected + dropped.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from time import process_time

import numpy as np

from emulator.scenario import Scenario, load_scenario, scenario_names
from host.capture.operator_desk import OperatorDesk
from host.capture.snapshot import Snapshots
from host.links.transport import Chunk
from host.trial.live import Trial
from host.trial.state import LinkView, RecordingView
from tests.recorded_trials import virtual_chunks

GAPS_S = (0.2, 0.6, 2.0)
CHUNK_S = 0.1
"""What one read brings."""
LONGEST_S = 60.0


@dataclass(frozen=True)
class Gap:
    """Chunks received from ``at_s`` on, for ``length_s``, are lost; ``reopened``: by a link opened again."""

    at_s: float
    length_s: float
    reopened: bool

    def cut(self, chunks: Sequence[Chunk]) -> Iterator[Chunk]:
        """Return what is left of the chunks, which are in order."""
        start_ns, open_again = chunks[0].host_time_ns, self.reopened
        for chunk in chunks:
            elapsed_s = (chunk.host_time_ns - start_ns) / 1e9
            if elapsed_s < self.at_s:
                yield chunk
            elif elapsed_s >= self.at_s + self.length_s:
                if open_again:
                    open_again = False
                    yield Chunk(b"", chunk.host_time_ns)
                yield chunk


def shortened(name: str, cycles: int) -> Scenario:
    """Return a shipped scenario with so many cycles, and its slip among them; its faults stay where they are."""
    scenario = load_scenario(name)
    if scenario.drift.mode == "slip":
        cycles = max(cycles, scenario.drift.slip_cycle + 1)
    return replace(scenario, motion=replace(scenario.motion, cycles=min(cycles, scenario.motion.cycles)))


def what_fails(chunks: Sequence[Chunk]) -> list[str]:
    """Run chunks through the live path of a capture, alarms too; return a sentence on each thing that goes wrong."""
    trial = Trial()
    snapshots = Snapshots(trial, OperatorDesk(trial))
    start_ns = chunks[0].host_time_ns
    for number, chunk in enumerate(chunks):
        trial.feed(chunk)
        if number % 5 == 0:
            elapsed_s = (chunk.host_time_ns - start_ns) / 1e9
            snapshots.at(chunk.host_time_ns, elapsed_s, LinkView("memory:"), RecordingView())
    trial.finish()
    found = list(trial.failures)
    losses = trial.assembler.losses()
    if losses.produced != losses.received + losses.lost + losses.rejected + losses.dropped:
        found.append(f"the ledger does not sum up: {losses}")
    return found


def gaps(end_s: float, every_s: float) -> Iterator[Gap]:
    """Return every gap of the sweep."""
    for number, at_s in enumerate(np.arange(every_s, end_s, every_s)):
        for length_s in GAPS_S:
            yield Gap(float(at_s), length_s, reopened=number % 2 == 1)


def sweep(name: str, every_s: float, cycles: int) -> tuple[int, list[str]]:
    """Return how many gaps were tried in a scenario, and what went wrong in them."""
    chunks, _ = virtual_chunks(shortened(name, cycles), CHUNK_S, duration_s=LONGEST_S)
    if not chunks:
        return 0, []
    end_s = (chunks[-1].host_time_ns - chunks[0].host_time_ns) / 1e9
    tried, wrong = 0, []
    for gap in gaps(end_s, every_s):
        tried += 1
        left = list(gap.cut(chunks))
        if left:
            wrong += [f"{name}, {gap}: {sentence}" for sentence in what_fails(left)]
    return tried, wrong


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gaps", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help="by default all that are shipped")
    parser.add_argument("--every", type=float, default=0.1, metavar="S", help="a gap so often (%(default)s)")
    parser.add_argument("--cycles", type=int, default=4, help="at most so many cycles of each (%(default)s)")
    chosen = parser.parse_args(arguments)
    total, failed = 0, 0
    for name in chosen.scenarios or scenario_names():
        start_s = process_time()
        tried, wrong = sweep(name, chosen.every, chosen.cycles)
        total, failed = total + tried, failed + len(wrong)
        print(f"{name:20}{tried:>8} gaps {len(wrong):>5} wrong {process_time() - start_s:>8.1f} s", flush=True)
        for sentence in wrong[:5]:
            print(f"    {sentence}", flush=True)
    print(f"\n{total} gaps in all, {failed} wrong")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
