"""How far mapped sample times jitter on simulated links: lower envelope, live and offline, and plain regression.

    python -m benchmarks.clock_jitter [--duration 7200] [--seed 1]

The error is mapped minus true sample time, less its median (the link's constant delay, which nobody can see one way),
from the end of the warm-up on. Nothing depends on the machine but the column of processor time.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from benchmarks.clock_links import LINKS, FloatArray, IntArray, SimulatedLink
from host.clock.estimate import ClockEstimate
from host.clock.estimator import ClockEstimator
from host.clock.remap import remap

GOALS_MS = {"usb": 0.1, "ftdi": 0.3, "can": 0.04, "ble": 0.7}
"""99th percentile of the live estimate's error."""


@dataclass(frozen=True, eq=False)
class CausalRun:
    """What a live capture of a simulated link gives."""

    host_ns: IntArray
    warm_up_s: float
    steps: int
    estimate: ClockEstimate
    cpu_us_per_chunk: float


def chunk_bounds(link: SimulatedLink) -> tuple[IntArray, IntArray]:
    """Return first and last sample of every chunk."""
    last = np.flatnonzero(np.diff(link.arrival_ns, append=-1))
    return np.concatenate([[0], last[:-1] + 1]), last


def causal(link: SimulatedLink) -> CausalRun:
    """Feed the chunks as they arrive; map each with what is known at its arrival."""
    estimator = ClockEstimator()
    first, last = chunk_bounds(link)
    newest, span = link.device_us[last].tolist(), (link.device_us[last] - link.device_us[first]).tolist()
    lines, steps = [], 0
    began = time.process_time()
    for device_us, span_us, host_ns in zip(newest, span, link.arrival_ns[last].tolist(), strict=True):
        steps += estimator.feed(device_us, host_ns, span_us) is not None
        assert estimator.line is not None
        lines.append(estimator.line)
    cpu_s = time.process_time() - began
    n = last - first + 1
    at_us = np.repeat(np.array([line.at_us for line in lines]), n)
    delay_ns = np.repeat(np.array([line.delay_ns for line in lines]), n)
    slope = np.repeat(np.array([line.slope for line in lines]), n)
    mapped = 1000 * link.device_us + np.rint(delay_ns + slope * (link.device_us - at_us)).astype(np.int64)
    estimate = estimator.estimate()
    assert estimate is not None
    warm_up_s = float("inf") if estimate.warm_up_s is None else estimate.warm_up_s
    return CausalRun(mapped, warm_up_s, steps, estimate, 1e6 * cpu_s / len(last))


def regression(link: SimulatedLink, window_s: float = 60.0) -> IntArray:
    """Map with the least-squares line through all chunks of the past window, refitted every second."""
    _, last = chunk_bounds(link)
    x = 1e-6 * link.device_us[last]
    y = 1e-9 * link.arrival_ns[last] - x
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (np.ones_like(x), x, y, x * x, x * y)]
    out = np.zeros(len(link.device_us), dtype=np.int64)
    arrival_s = 1e-9 * link.arrival_ns
    for second in range(int(arrival_s[0]) + 3, int(arrival_s[-1]) + 1):
        stop = np.searchsorted(1e-9 * link.arrival_ns[last], second)
        start = np.searchsorted(x, x[stop - 1] - window_s)
        n, sx, sy, sxx, sxy = (s[stop] - s[start] for s in sums)
        slope = (n * sxy - sx * sy) / (n * sxx - sx * sx)
        piece = slice(*np.searchsorted(arrival_s, [second, second + 1]))
        device_s = 1e-6 * link.device_us[piece]
        out[piece] = np.rint(1e9 * (device_s + sy / n + slope * (device_s - sx / n)))
    return out


def error_ms(link: SimulatedLink, host_ns: IntArray, after_s: float = 0.0) -> FloatArray:
    """Return the distance of mapped from true times about its median, for samples later than ``after_s``, ms."""
    late = link.true_s > link.true_s[0] + after_s
    error = 1e-6 * host_ns[late] - 1e3 * link.true_s[late]
    distance: FloatArray = np.abs(error - np.median(error))
    return distance


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=7200.0, help="simulated seconds of each link")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(f"{options.duration:g} s simulated, 100 Hz, skew 100 ppm, wandering; seed {options.seed}; errors in ms")
    print(
        f"{'link':45} {'goal':>5} {'live p50':>8} {'p99':>7} {'max':>7} {'offline p99':>11} {'regression p99':>14}"
        f" {'warm-up s':>9} {'window s':>8} {'us/chunk':>8}"
    )
    for busy in (False, True):
        for name, make in LINKS.items():
            link = make(np.random.default_rng(options.seed), options.duration, busy)
            live = causal(link)
            after_s = max(live.warm_up_s, 60.0)
            p50, p99, worst = np.percentile(error_ms(link, live.host_ns, live.warm_up_s), [50, 99, 100])
            offline = remap(link.device_us, link.arrival_ns)
            plain = regression(link, live.estimate.window_s)
            print(
                f"{link.name + (', busy' if busy else ''):45} {GOALS_MS.get(name, float('nan')):5.2f} {p50:8.3f}"
                f" {p99:7.3f} {worst:7.3f} {np.percentile(error_ms(link, offline.host_time_ns), 99):11.3f}"
                f" {np.percentile(error_ms(link, plain, after_s), 99):14.3f} {live.warm_up_s:9.0f}"
                f" {live.estimate.window_s:8.0f} {live.cpu_us_per_chunk:8.1f}"
            )


if __name__ == "__main__":
    main()
