"""Offline score of ten hours, with a profile that shows where the time goes."""

from __future__ import annotations

import cProfile
import io
import pstats
import re

import numpy as np

from analysis.scoring.trial import score_series
from analysis.series import OrientationSeries
from benchmarks.measurement import Topic, cpu_s, figure
from benchmarks.sample_streams import turning

HOURS = 10
RATE_HZ = 200.0
PERIOD_S = 4.0
PROFILE_LINES = 12


def long_series(n: int, rate_hz: float = RATE_HZ, period_s: float = PERIOD_S) -> OrientationSeries:
    """Return n samples of an object that is turned to and fro, with a little noise."""
    rng = np.random.default_rng(2)
    quats = turning(n, rate_hz, period_s) + rng.normal(0.0, 2e-4, (n, 4))
    quats /= np.linalg.norm(quats, axis=1)[:, None]
    return OrientationSeries(np.arange(n) / rate_hz, quats, np.arange(n), "sequence", source="benchmark")


def measure(quick: bool = False) -> Topic:
    """Measure everything of this topic."""
    hours = HOURS / 10 if quick else HOURS
    topic = Topic(f"Scoring: {hours:g} hours at {RATE_HZ:.0f} Hz, in memory")
    n = int(hours * 3600 * RATE_HZ)
    series = long_series(n)
    score = score_series(series)
    assert score.valid, score.reasons
    expected = n / RATE_HZ / PERIOD_S
    assert abs(len(score.endpoints) - expected) < 3, (len(score.endpoints), expected)
    times = [cpu_s(lambda: score_series(series)) for _ in range(1 if quick else 2)]
    note = f"{len(score.endpoints)} end points"
    topic.rows.append(figure("score", times, "s CPU", note))
    topic.rows.append(figure("rate", [n / t / 1e6 for t in times], "M samples/s"))
    topic.rows.append(figure("per cycle", [1e6 * t / len(score.endpoints) for t in times], "µs"))
    if not quick:
        topic.text = profile_of(series)
    return topic


def profile_of(series: OrientationSeries) -> str:
    """Functions of ours by the time spent in and below them."""
    profiler = cProfile.Profile()
    profiler.runcall(score_series, series)
    text = io.StringIO()
    stats = pstats.Stats(profiler, stream=text)
    stats.strip_dirs().sort_stats("cumulative").print_stats(3 * PROFILE_LINES)
    lines = [line for line in text.getvalue().splitlines() if re.match(r"\s+\d+(/\d+)?\s+\d", line)]
    return "\n".join(["   ncalls  tottime  percall  cumtime  percall", *lines[: 2 * PROFILE_LINES]])
