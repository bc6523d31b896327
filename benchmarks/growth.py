"""Cost and memory against length: flat per sample, or the growth is a fault."""

from __future__ import annotations

import tracemalloc
from statistics import median

import numpy as np

from analysis.scoring.trial import score_series
from benchmarks.measurement import COST, Curve, Topic, cpu_s, figure
from benchmarks.sample_streams import FRAME_BYTES, frame_rows, turning
from benchmarks.scoring import RATE_HZ, long_series
from firmware_protocol.serial.decoder import StreamDecoder
from host.links.transport import Chunk
from host.trial.live import Trial

FLAT = 2.0
"""Largest cost per unit over the smallest that still counts as flat, noise of a shared machine included."""
_BLOCK = 1 << 16  # samples: the sequence number has wrapped once, so the block can follow itself


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    topic = Topic("Growth: cost and memory against length")
    _decode(topic, quick)
    _score(topic, quick)
    _cycles(topic, quick)
    _objects(topic, quick)
    _live(topic, quick)
    return topic


def _add(topic: Topic, name: str, x_label: str, y_label: str, x: list[float], y: list[float]) -> None:
    topic.curves.append(Curve(name, x_label, y_label, tuple(x), tuple(y)))
    span = f"{x[0]:,.0f} to {x[-1]:,.0f} {x_label}"
    # What falls with length is a fixed cost that weighs less and less: growth is what a longer one costs more.
    rise = max(later / min(y[: k + 1]) for k, later in enumerate(y))
    topic.rows.append(figure(f"{name}: largest {y_label} over the least before it", [rise], "×", span, FLAT, COST))


def _decode(topic: Topic, quick: bool) -> None:
    """Streams of 10^4 to 10^8 samples, in reads of 64 KiB; memory is that of the decoder, results are let go."""
    block = frame_rows(turning(_BLOCK)).tobytes()
    x, y = [], []
    for power in range(4, 7 if quick else 9):
        n = 10**power
        cost = []
        for _ in range(5 if power < 7 else 1):
            feed = StreamDecoder().feed

            def run(n: int = n, feed=feed) -> None:  # noqa: ANN001
                left = n * FRAME_BYTES
                while left > 0:
                    part = block if left >= len(block) else block[:left]
                    for at in range(0, len(part), 1 << 16):
                        feed(part[at : at + (1 << 16)])
                    left -= len(part)

            cost.append(1e6 * cpu_s(run) / n)
        x.append(float(n))
        y.append(median(cost))
    _add(topic, "decode", "samples", "µs/sample", x, y)


def _score(topic: Topic, quick: bool) -> None:
    """Scoring recordings of 10^4 to 10^6.5 samples: the cycles grow with them."""
    x, y = [], []
    for n in (10_000, 30_000, 100_000) if quick else (10_000, 30_000, 100_000, 300_000, 1_000_000, 3_000_000):
        series = long_series(n)
        cost = [1e6 * cpu_s(lambda series=series: score_series(series)) / n for _ in range(3 if n < 10**6 else 1)]
        x.append(float(n))
        y.append(median(cost))
    _add(topic, "score", "samples", "µs/sample", x, y)


def _cycles(topic: Topic, quick: bool) -> None:
    """Scoring the same length with more and more cycles in it."""
    n = 36_000 if quick else 360_000
    x, y = [], []
    for period_s in (16.0, 8.0, 4.0, 2.0, 1.0):
        series = long_series(n, period_s=period_s)
        cycles = n / RATE_HZ / period_s
        cost = [1e6 * cpu_s(lambda series=series: score_series(series)) / cycles for _ in range(3)]
        x.append(cycles)
        y.append(median(cost))
    _add(topic, f"score of {n} samples", "cycles", "µs/cycle", x, y)


def _objects(topic: Topic, quick: bool) -> None:
    """Objects on one host, each with a trial of its own, ten samples a read."""
    chunks = stream_chunks(2000, 10)
    x, y = [], []
    for count in (1, 2, 4, 8) if quick else (1, 2, 4, 8, 16, 32):
        trials = [Trial() for _ in range(count)]

        def run(trials: list[Trial] = trials) -> None:
            for chunk in chunks:
                for trial in trials:
                    trial.feed(chunk)

        x.append(float(count))
        y.append(1e6 * cpu_s(run) / (count * 2000))
    _add(topic, "live trials", "objects", "µs/sample", x, y)


def stream_chunks(n: int, per_chunk: int, first: int = 0, period_s: float = 2.0) -> list[Chunk]:
    """Chunks of a link that delivers so many samples a read, from sample ``first`` on."""
    data = frame_rows(turning(n + first, period_s=period_s)[first:], first).tobytes()
    size = per_chunk * FRAME_BYTES
    return [
        Chunk(data[at : at + size], 10**9 + (first + (at + size) // FRAME_BYTES) * 10**6)
        for at in range(0, len(data), size)
    ]


def _live(topic: Topic, quick: bool) -> None:
    """One live trial that goes on and on: cost and memory of every further stretch."""
    trial = Trial()
    stretch = 20_000
    x, cost, memory = [], [], []
    tracemalloc.start()
    for k in range(8 if quick else 24):
        chunks = stream_chunks(stretch, 20, k * stretch, 0.5)

        def run(chunks: list[Chunk] = chunks) -> None:
            for chunk in chunks:
                trial.feed(chunk)

        used = cpu_s(run)
        del chunks
        x.append(float((k + 1) * stretch))
        cost.append(1e6 * used / stretch)
        memory.append(tracemalloc.get_traced_memory()[0] / 2**20)
    tracemalloc.stop()
    assert trial.n_endpoints > 200  # rows of cycles are kept up to so many
    half = len(x) // 2
    _add(topic, "live trial, its memory traced", "samples", "µs/sample", x[half:], cost[half:])
    growth = (memory[-1] - memory[half]) / (x[-1] - x[half]) * 2**20
    note = f"{memory[-1]:.1f} MiB after {np.format_float_positional(x[-1] / 1e6, 2)} M samples"
    topic.rows.append(figure("live trial: memory growth", [growth], "bytes/sample", note, 1.0, COST))
    topic.curves.append(Curve("live trial", "samples", "MiB", tuple(x), tuple(memory)))
