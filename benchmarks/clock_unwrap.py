"""How many samples are unwrapped wrongly over gaps of hours, with skew, lateness, reordering: counted against truth.

python -m benchmarks.clock_unwrap [--streams 2000] [--seed 1]
"""

from __future__ import annotations

import argparse

import numpy as np

from host.clock.unwrap import ClockUnwrapper

MODULUS = 2**32


def wrong_samples(rng: np.random.Generator, longest_gap_s: float) -> tuple[int, int, int]:
    """Feed one stream of 60 chunks; return samples, wrong samples, and jumps although there was none."""
    unwrapper = ClockUnwrapper()
    rate = 1 + 1e-6 * rng.uniform(-200, 200)
    first_us = int(rng.integers(0, MODULUS))
    host_s = sent_s = 0.0
    n = wrong = jumps = 0
    for _ in range(60):
        # Gaps of every length from 10 ms on; one chunk in five is late, by up to 20 s.
        host_s += 0.01 * (longest_gap_s / 0.01) ** rng.random()
        late_s = rng.uniform(0, 20.0) if rng.random() < 0.2 else 0.002
        newest_s = max(sent_s, host_s - late_s)
        sampled_s = newest_s - 0.01 * np.arange(rng.integers(1, 40))[::-1]
        sampled_s = sampled_s[sampled_s >= sent_s] if (sampled_s >= sent_s).any() else np.array([newest_s])
        sent_s = newest_s
        truth = first_us + np.rint(1e6 * rate * sampled_s).astype(np.int64)
        if len(truth) > 1 and rng.random() < 0.3:
            k = rng.integers(1, len(truth))
            truth[[k - 1, k]] = truth[[k, k - 1]]
        unwrapped = unwrapper.unwrap((truth % MODULUS).astype(np.uint32), int(1e9 * host_s))
        if len(unwrapped) < len(truth):
            jumps += 1
            unwrapper.new_segment()
            truth = truth[: len(unwrapped)]
        if n == 0:
            shift = int(truth[0]) // MODULUS * MODULUS  # a segment starts within the first wrap
        n += len(truth)
        wrong += int((unwrapped + shift != truth).sum())
    return n, wrong, jumps


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--streams", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    for longest_gap_s in (60.0, 3600.0, 12 * 3600.0, 72 * 3600.0):
        n, wrong, steps = np.sum([wrong_samples(rng, longest_gap_s) for _ in range(options.streams)], axis=0)
        print(
            f"gaps up to {longest_gap_s / 3600:6.2f} h, skew +-200 ppm: {n} samples, {wrong} wrong, {steps} false steps"
        )


if __name__ == "__main__":
    main()
