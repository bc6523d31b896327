"""Runs that are long: in slices, over days if need be, with all that is known of them in one file.

Input number n of a seed is always the same, so that the state of a run is its seed and how many inputs were tried; and
a find is named by its number.
"""

from __future__ import annotations

import json
import subprocess
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from random import Random

from tests.fuzz.result.bounds import TooSlowError, limited_time, peak_memory_mb
from tests.fuzz.result.road import BrokenError

ROOT = Path(__file__).parents[3]


@dataclass
class Find:
    """Something that must not be, and how often it was met."""

    what: str
    """Of the first."""
    first: int
    """Number of the first input that has it."""
    inputs: int = 0
    examples: list[int] = field(default_factory=list)
    """Numbers of the first few inputs."""


@dataclass
class Run:
    """State of a run."""

    target: str
    seed: int
    commit: str
    inputs: int = 0
    processor_s: float = 0.0
    slowest_s: float = 0.0
    slowest: int = 0
    memory_mb: float = 0.0
    outcomes: dict[str, int] = field(default_factory=dict)
    """How many inputs became what."""
    finds: dict[str, Find] = field(default_factory=dict)
    """By what is wrong and where."""

    def try_inputs(self, try_one: Callable[[Random], str], n: int) -> None:
        """Try the next n inputs."""
        for number in range(self.inputs, self.inputs + n):
            before = time.process_time()
            became = tried(self, try_one, number)
            seconds = time.process_time() - before
            self.processor_s += seconds
            if seconds > self.slowest_s:
                self.slowest_s, self.slowest = seconds, number
            if isinstance(became, str):
                self.outcomes[became] = self.outcomes.get(became, 0) + 1
                continue
            find = self.finds.setdefault(signature(became), Find(f"{type(became).__name__}: {became}"[:300], number))
            find.inputs += 1
            find.examples = [*find.examples, number][:5]
        self.inputs += n
        self.memory_mb = max(self.memory_mb, round(peak_memory_mb(), 1))

    def line(self) -> str:
        """Return what was reached, in a line."""
        became = ", ".join(f"{n} {name}" for name, n in sorted(self.outcomes.items()))
        each_ms = 1e3 * self.processor_s / max(self.inputs, 1)
        return (
            f"{self.target}, seed {self.seed}, commit {self.commit}: {self.inputs} inputs in {self.processor_s:.0f} s "
            f"of processor time, {each_ms:.2f} ms an input; slowest {1e3 * self.slowest_s:.0f} ms "
            f"(input {self.slowest}), {self.memory_mb:.0f} MB at most; {len(self.finds)} kinds of finds; {became}"
        )

    def save(self, path: Path) -> None:
        """Write the state; a run that is killed meanwhile leaves the one before."""
        new = path.with_suffix(".new")
        new.write_text(json.dumps(asdict(self), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        new.replace(path)


def load(path: Path) -> Run:
    """Return the state of a run that goes on."""
    values = json.loads(path.read_text(encoding="utf-8"))
    return Run(**{**values, "finds": {key: Find(**find) for key, find in values["finds"].items()}})


def tried(run: Run, try_one: Callable[[Random], str], number: int) -> str | BaseException:
    """Try one input within its bounds; return what became of it, or what was raised."""
    try:
        with limited_time():
            return try_one(Random(f"{run.target} {run.seed} {number}"))
    except (Exception, TooSlowError) as error:  # noqa: BLE001 - whatever it is, it is a find
        return error


def signature(error: BaseException) -> str:
    """Return what finds of one kind have in common: the check, or the error and where in this project it was raised."""
    if isinstance(error, BrokenError):
        return error.check
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if ROOT in Path(frame.filename).parents]
    place = f"{Path(frames[-1].filename).relative_to(ROOT)}:{frames[-1].name}" if frames else "elsewhere"
    return f"{type(error).__name__} in {place}"


def commit_here() -> str:
    """Return the commit of this tree, or what a snapshot of it notes."""
    noted = ROOT / "COMMIT"
    if noted.is_file():
        return noted.read_text().strip()
    done = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False, timeout=30
    )
    return done.stdout.strip() or "unknown"
