"""What the clock estimator finds."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.scoring.recorded_parts import LiveClock
from analysis.scoring.result_parts import known
from host.clock.interval import OffsetInterval


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """Device time to host time, as known at one moment; the link's constant delay is in it."""

    segment: int
    """Number of the clock segment it holds for."""
    reference_us: int
    """Device time (unwrapped) at which the offset is given, the newest one heard, us."""
    offset_ns: float
    """Host minus device time at ``reference_us``, ns, by the lower envelope."""
    skew_ppm: float
    """Rate of the device clock over the host's, minus one; positive where the device is fast."""
    skew_uncertainty_ppm: float
    """What the link usually adds over the time the kept delays span: how far the line may turn. inf at first."""
    interval: OffsetInterval
    """Where the true offset at ``reference_us`` lies. It may lie below ``offset_ns``, where round trips show that all
    samples come with a constant delay."""
    jitter_p50_ns: float
    """Median of the arrival residuals (arrival minus mapped time of a chunk's newest sample), last 2048 chunks, ns."""
    jitter_p99_ns: float
    """Their 99th percentile, ns."""
    warm: bool
    """Whether the line can be relied on now: the skew is known well, or the window is full."""
    warm_up_s: float | None
    """Host time it took to become warm for the first time in this segment, s; None if it never was."""
    n: int
    """Chunks taken into account in this segment."""
    n_bins: int
    """Seconds with data in the window."""
    window_s: float
    """Window in use, s."""
    bursty: bool
    """Whether the link is judged bursty."""

    def account(self) -> LiveClock:
        """Return the estimate as a part of a result."""
        bounds_ns, width_ns = self.interval.bounds_ns, self.interval.width_ns
        return LiveClock(
            segments=self.segment + 1,
            skew_ppm=known(self.skew_ppm) if self.warm else None,
            skew_uncertainty_ppm=known(self.skew_uncertainty_ppm),
            offset_interval_ms=None if bounds_ns is None else (bounds_ns[0] / 1e6, bounds_ns[1] / 1e6),
            offset_uncertainty_ms=None if width_ns is None else width_ns / 1e6,
            consistent=self.interval.consistent,
            round_trips=self.interval.n_round_trips,
            jitter_p50_ms=known(self.jitter_p50_ns / 1e6),
            jitter_p99_ms=known(self.jitter_p99_ns / 1e6),
            warm_up_s=self.warm_up_s,
            bursty=self.bursty,
        )
