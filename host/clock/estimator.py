"""Where the device clock stands on the host's time line, learnt as chunks arrive.

Only the newest sample of a chunk counts: the others waited for it. Of these pairs (device time, host arrival)
the least delayed one of every second is kept, and the line below the kept ones maps device to host time. A constant
delay of the link cannot be seen one way; TIME_REQUEST round trips bound it.
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from host.clock.envelope import DelayLine, Point, envelope_line, line_with_slope, scatter_ns
from host.clock.estimate import ClockEstimate
from host.clock.interval import OffsetInterval
from host.clock.seconds import Seconds
from host.clock.unwrap import MAX_SKEW_PPM

RESIDUALS_KEPT = 2048
"""Of so many chunks the jitter is stated."""
ROUND_TRIPS_KEPT = 64
"""So many of the last round trips bound the offset."""
WINDOW_S = 60.0
"""Length of the window. The crystal's wander over it is an error, and so is a beat of two clocks that is longer."""
BURSTY_WINDOW_S = 300.0
"""Length for bursty links: the age of a burst's newest sample drifts slowly against the burst's clock."""
BURST_SPAN_S = 0.012
"""A link is bursty when most of its chunks span at least this much device time ..."""
BURST_SCATTER_S = 0.003
"""... or when of ten seconds' least delays one is this far above the line."""
WANDER_PPM = 5.0
"""How far the skew may change unseen; widens the offset interval, and the bounds for steps after a gap."""
WARM_UNCERTAINTY_PPM = 50.0
"""The estimate is warm once the skew is known this well, or the window is full ..."""
WARM_BINS = 10
"""... and so many seconds had data (and, if bursty, half the window has passed)."""
STEP_S = 0.02
"""Arrivals this much before the line (plus twice the scatter) prove a step: nothing arrives before it is sent."""
LATE_STEP_S = 0.05
"""Arrivals this much after the line (plus five times the scatter) are taken for a step ..."""
LATE_STEP_BINS = 10
"""... if they last for so many seconds with data. A round trip proves it at once."""


class ClockEstimator:
    """Causal lower-envelope estimate; bounded memory, about a microsecond per chunk and a refit every second."""

    def __init__(self) -> None:
        self.segment = 0
        """Number of the present segment, from 0."""
        self._known_slope: float | None = None  # of a warm time before: the crystal stays the same over a reset
        self._start_segment()

    def new_segment(self) -> None:
        """Start again: the device clock was reset, or may have been. The skew is kept as a first guess.

        A segment without a sample goes on instead.
        """
        if self.line is not None:
            self.segment += 1
            self._start_segment()

    def _start_segment(self) -> None:
        self.line: DelayLine | None = None
        """The mapping alone, as it stands; None before the segment's first sample."""
        self._newest_us = 0
        self.segment_start_ns = 0
        """Arrival of the segment's first sample, ns; of a late step, which is seen late, before it was reported."""
        self._n = 0
        self._warm_up_s: float | None = None
        self._burst_share = 0.0
        self.bursty = False
        """Whether the link is judged bursty now."""
        self._residuals: deque[float] = deque(maxlen=RESIDUALS_KEPT)
        self._round_trips: deque[tuple[Point, Point]] = deque(maxlen=ROUND_TRIPS_KEPT)
        self._forget_seconds()

    def _forget_seconds(self) -> None:
        self._seconds = Seconds()
        self._warm = False
        self._scatter_ns = 0.0
        self._slope_uncertainty = float("inf")  # ns per us

    def map(self, device_us: npt.NDArray[np.int64], host_time_ns: int) -> npt.NDArray[np.int64]:
        """Take the samples of one chunk into account, and map them to host time.

        Parameters
        ----------
        device_us : (n,) int64
            Their device time, unwrapped, us; n >= 1.
        host_time_ns : int
            Arrival of the chunk, ns, monotonic.

        Returns
        -------
        (n,) int64
            Host time at which each was taken, plus the link's constant delay, ns, as known now. From chunk to chunk it
            may go back by the estimate's correction: order samples by device time.
        """
        newest_us, oldest_us = int(device_us.max()), int(device_us.min())
        self.feed(newest_us, host_time_ns, newest_us - oldest_us)
        assert self.line is not None  # it has just been fed
        return self.line.to_host_ns(device_us)

    def feed(self, device_us: int, host_time_ns: int, span_us: int = 0) -> float | None:
        """Take the newest sample of a chunk into account.

        Parameters
        ----------
        device_us : int
            Its device time, unwrapped, us.
        host_time_ns : int
            Arrival of the chunk, ns, monotonic.
        span_us : int
            Device time from the oldest to the newest sample of the chunk, us; shows bursty links.

        Returns
        -------
        float or None
            Mostly None. If the delay changed as only a step of the device clock does, by how much, ns; a new segment
            has started then, and this sample belongs to it.
        """
        delay_ns = host_time_ns - 1000 * device_us
        step_ns = self._close_second(host_time_ns) if self._seconds.is_new(host_time_ns) else None
        line = self.line
        if line is None:
            self.segment_start_ns = host_time_ns
            self._newest_us = device_us
            line = self.line = DelayLine(device_us, float(delay_ns), self._known_slope or 0.0)
        gap_us = max(0, device_us - self._newest_us)
        residual_ns = delay_ns - line.delay_at(device_us)
        if residual_ns < 0.0:
            if self._warm and residual_ns < -self._early_bound_ns(gap_us):
                self.new_segment()
                self.feed(device_us, host_time_ns, span_us)
                return residual_ns
            # The line was too high: nothing arrives before it is sent.
            line = self.line = line.lowered(-residual_ns)
            residual_ns = 0.0
        if gap_us > 1e6 * self._window_s():
            # What was known of the offset is too old; of the skew it is the best guess.
            self._forget_seconds()
            self.line = DelayLine(device_us, float(delay_ns), line.slope)
            residual_ns = 0.0
        self._seconds.enter((device_us, delay_ns), residual_ns, host_time_ns)
        self._n += 1
        self._newest_us = max(self._newest_us, device_us)
        self._residuals.append(residual_ns)
        self._burst_share += ((span_us >= 1e6 * BURST_SPAN_S) - self._burst_share) / 64
        return step_ns

    def feed_round_trip(
        self, host_send_ns: int, receive_us: int, transmit_us: int, host_receive_ns: int
    ) -> float | None:
        """Bound the offset by a TIME_REQUEST and its reply; return as :meth:`feed` does.

        The request left before it was received and the reply was sent before it arrived, so at those device times
        (unwrapped into this segment) the offset is at least ``host_send - receive`` and at most ``host_receive -
        transmit``. A round trip that contradicts itself is ignored. Replies do not enter the envelope: they are too
        few, and may be faster than samples, which would make the mapped time jitter.
        """
        if self.line is None:
            return None
        low, high = (receive_us, host_send_ns - 1000 * receive_us), (transmit_us, host_receive_ns - 1000 * transmit_us)
        slack_ns = 1e-3 * MAX_SKEW_PPM * max(0, transmit_us - receive_us)
        if transmit_us < receive_us or low[1] > high[1] + slack_ns:
            return None
        if self._warm:
            late_ns = low[1] - self.line.delay_at(receive_us)
            if late_ns > self._early_bound_ns(max(0, receive_us - self._newest_us)):
                self.new_segment()
                return late_ns
        self._round_trips.append((low, high))
        return None

    def estimate(self) -> ClockEstimate | None:
        """Return what is known now; None before the segment's first sample."""
        line = self.line
        if line is None:
            return None
        at_us = self._newest_us
        tolerance = min(self._slope_uncertainty, 1e-3 * MAX_SKEW_PPM) + 1e-3 * WANDER_PPM

        def bound(point: Point, sign: int) -> float:
            """Carry a bound over to ``at_us``, the wider the older it is."""
            x, y = point
            return y + line.slope * (at_us - x) + sign * tolerance * abs(at_us - x)

        uppers = [*self._seconds.kept, *(high for _, high in self._round_trips)]
        if self._seconds.best is not None:
            uppers.append(self._seconds.best)
        low_ns = max((bound(low, -1) for low, _ in self._round_trips), default=None)
        high_ns = min(bound(point, 1) for point in uppers)
        jitter = np.percentile(self._residuals, [50, 99]) if self._residuals else np.zeros(2)
        return ClockEstimate(
            segment=self.segment,
            reference_us=at_us,
            offset_ns=line.delay_at(at_us),
            skew_ppm=1e6 * (1000.0 / (1000.0 + line.slope) - 1.0),
            skew_uncertainty_ppm=1e3 * self._slope_uncertainty,
            interval=OffsetInterval(low_ns, high_ns, low_ns is None or low_ns <= high_ns, len(self._round_trips)),
            jitter_p50_ns=float(jitter[0]),
            jitter_p99_ns=float(jitter[1]),
            warm=self._warm,
            warm_up_s=self._warm_up_s,
            n=self._n,
            n_bins=len(self._window()),
            window_s=self._window_s(),
            bursty=self.bursty,
        )

    def _window_s(self) -> float:
        return BURSTY_WINDOW_S if self.bursty else WINDOW_S

    def _window(self) -> list[Point]:
        oldest_us = self._newest_us - 1e6 * self._window_s()
        return [point for point in self._seconds.kept if point[0] >= oldest_us]

    def _early_bound_ns(self, gap_us: int) -> float:
        drift = self._slope_uncertainty + 1e-3 * WANDER_PPM
        return 1e9 * STEP_S + 2 * self._scatter_ns + drift * gap_us

    def _close_second(self, host_time_ns: int) -> float | None:
        """Keep the past second's best point and refit; return the change of delay if it has been late for too long."""
        seconds = self._seconds
        point, residual_ns = seconds.close()
        if point is None:
            return None
        if self._warm and residual_ns > 1e9 * LATE_STEP_S + 5 * self._scatter_ns:
            # So late, it means nothing for the line, unless it goes on like this.
            n_late = seconds.put_aside(point, residual_ns)
            return self._restart_late(host_time_ns) if n_late >= LATE_STEP_BINS else None
        seconds.keep(point, self._newest_us - 1e6 * BURSTY_WINDOW_S)
        self._refit(host_time_ns)
        return None

    def _restart_late(self, host_time_ns: int) -> float:
        """Start a segment with the late seconds as its first."""
        late, step_ns = sorted(self._seconds.late), self._seconds.late_least_ns
        self.new_segment()
        self.segment_start_ns, self._newest_us = 1000 * late[0][0] + late[0][1], late[-1][0]
        self._seconds.kept.extend(late)
        self._refit(host_time_ns)
        return step_ns

    def _refit(self, host_time_ns: int) -> None:
        self._judge_bursts()
        points = self._window()
        if not points:
            return
        line = envelope_line(points)
        max_slope = 1e-3 * MAX_SKEW_PPM
        self._scatter_ns = scatter_ns(points, line)
        span_us = points[-1][0] - points[0][0]
        enough = len(points) >= WARM_BINS
        # The link's own clock beats against the device's: while less than one beat has been seen, the kept delays
        # scatter little although the line is wrong. What the link usually adds bounds how far a beat may go.
        usual_ns = sorted(self._residuals)[len(self._residuals) // 2] if self._residuals else 0.0
        spread_ns = max(self._scatter_ns, usual_ns)
        self._slope_uncertainty = spread_ns / span_us if enough else float("inf")
        if self.bursty:  # bursts are of one age for minutes, then of another: little scatter proves nothing
            enough = enough and span_us >= 0.5e6 * BURSTY_WINDOW_S
        known = self._slope_uncertainty <= 1e-3 * WARM_UNCERTAINTY_PPM or span_us > 0.9e6 * self._window_s()
        self._warm = enough and (self._warm or known)
        if not self._warm and self._known_slope is not None:
            line = line_with_slope(points, self._known_slope)
        elif not -max_slope <= line.slope <= max_slope:
            line = line_with_slope(points, min(max(line.slope, -max_slope), max_slope))
        if self._warm:
            self._known_slope = line.slope
            if self._warm_up_s is None:
                self._warm_up_s = 1e-9 * (host_time_ns - self.segment_start_ns)
        self.line = line

    def _judge_bursts(self) -> None:
        """Bursty by the chunks' own span, or by seconds' least delays that beat; half of both to be steady again."""
        points = list(self._seconds.kept)
        scatter = scatter_ns(points, envelope_line(points)) if len(points) >= WARM_BINS else 0.0
        share = 0.25 if self.bursty else 0.5
        limit_ns = 1e9 * BURST_SCATTER_S * (0.5 if self.bursty else 1.0)
        self.bursty = self._burst_share > share or scatter > limit_ns
