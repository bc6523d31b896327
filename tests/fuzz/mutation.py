"""Mutated inputs from seeds, reproducible: for runs without a fuzzing library."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

SEEDS = Path(__file__).parent / "seeds"
MAX_BYTES = 16384
_TOKENS = [
    b"\x00",
    b"\xff\xff\xff\xff",
    b"\x00\x01\x00\x00",
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b"\x1b[2J",
    b"[bold]",
    b"]]",
]


_OF_OTHERS = {"commands": ("bag", "cards", "recording", "scenario", "series")}
"""Targets that take what others take."""


def seeds_of(target: str) -> list[bytes]:
    """Return the committed seeds of a target, in order of name."""
    folders = _OF_OTHERS.get(target, (target,))
    return [path.read_bytes() for folder in folders for path in sorted((SEEDS / folder).iterdir())]


def mutated(target: str, n: int, seed: int) -> Iterator[bytes]:
    """Yield n inputs made from the seeds of a target; the same for the same seed."""
    rng = random.Random(f"{target} {seed}")
    seeds = seeds_of(target)
    for _ in range(n):
        data = bytearray(rng.choice(seeds))
        for _ in range(1 + int(rng.expovariate(0.5))):
            _mutate(data, rng, seeds)
        yield bytes(data[:MAX_BYTES])


def _mutate(data: bytearray, rng: random.Random, seeds: list[bytes]) -> None:
    at = rng.randrange(len(data) + 1)
    kind = rng.randrange(7)
    if kind == 0 and at < len(data):
        data[at] ^= 1 << rng.randrange(8)
    elif kind == 1 and at < len(data):
        data[at] = rng.randrange(256)
    elif kind == 2:
        data[at:at] = rng.randbytes(rng.randrange(1, 20))
    elif kind == 3:
        del data[at : at + rng.randrange(1, 60)]
    elif kind == 4:
        data[at:at] = rng.choice(_TOKENS)
    elif kind == 5:  # a piece of the same again
        start = rng.randrange(len(data) + 1)
        data[at:at] = data[start : start + rng.randrange(1, 200)]
    else:  # a piece of another
        other = rng.choice(seeds)
        start = rng.randrange(len(other) + 1)
        data[at:at] = other[start : start + rng.randrange(1, 200)]
