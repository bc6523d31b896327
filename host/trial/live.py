"""A trial as it happens: chunks in, cycles and a running score out, with bounded memory.

The same object runs under a live capture and under a replay. What it shows is provisional: the result is made from the
whole recording afterwards (:mod:`host.results.result`). Link and assembler decode and keep the ledger; everything else
only watches, and is guarded (:mod:`host.trial.guarded`).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from analysis.cycles.online.detector import OnlineCycleDetector, OnlineState
from analysis.cycles.settings import Endpoint
from analysis.scoring.recorded_parts import LiveClock
from analysis.sensor.baseline import StaticBaseline
from firmware_protocol.items import StreamItem
from firmware_protocol.packets import OrientationBatch
from host.clock.estimate import ClockEstimate
from host.clock.estimator import ClockEstimator
from host.links.transport import AnyChunk, GapChunk
from host.stream.blocks import SampleBlock, UnwrappedSamples
from host.stream.decoding import Link
from host.stream.rate import RateMeter
from host.stream.round_trips import RoundTrip
from host.stream.samples import SampleAssembler
from host.trial.guarded import Guarded
from host.trial.running_score import RunningScore
from host.trial.sensor import SensorWatch
from host.trial.state import UNCOUNTED, ClockView, CounterView, CycleRow, MotionView, SensorView, StreamView
from host.trial.turning import Turning

NONE_FOUND: list[Endpoint] = []
NOTHING_KNOWN = OnlineState()
NO_MORE_CYCLES = "no more cycles are counted, so none end the capture"


@dataclass(frozen=True, slots=True)
class DecodedBatch:
    """Samples as received, with the host time at which each was taken, for the recording's viewers' channel."""

    stamps_ns: npt.NDArray[np.int64]
    quats_wxyz: npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrialUpdate:
    """What one chunk brought."""

    items: list[StreamItem]
    """Packets in wire order."""
    sampled: bool
    """Whether samples are among them, whosever they are."""
    decoded: list[DecodedBatch]
    """Samples that have found their place; those held back come when it is known whose they are."""
    cycles: list[CycleRow]
    """Cycles confirmed by this chunk."""


class Trial:
    """Decodes, orders, finds cycles and scores them while the hand turns.

    Parameters
    ----------
    node : int, optional
        Node id of the object on a bus; by default the first that is heard.
    target_half_width_deg : float, optional
        Half-width of the interval that the capture aims at.
    baseline : StaticBaseline, optional
        Of the sensor, for its floor; by default from the rest before the motion, if there is one.
    """

    def __init__(
        self,
        node: int | None = None,
        target_half_width_deg: float | None = None,
        baseline: StaticBaseline | None = None,
    ) -> None:
        self.link = Link(node=node)
        self.assembler = SampleAssembler()
        self.assembler.on_segment.append(lambda _: self._clock.ask(ClockEstimator.new_segment, None))
        self.assembler.on_samples.append(self._map)
        self.failures: list[str] = []
        """A sentence on each part that failed and was switched off."""
        failures = self.failures
        self._clock = Guarded("the clock estimate", ClockEstimator(), failures, "viewers' samples have reception times")
        self._decoded: list[DecodedBatch] = []  # of the chunk under way
        self._detector = Guarded("the cycle detector", OnlineCycleDetector(), failures, NO_MORE_CYCLES)
        self._rate = Guarded("the rate of the samples", RateMeter(), failures, "it is no longer shown")
        self.score = Guarded("the running score", RunningScore(target_half_width_deg), failures, NO_MORE_CYCLES)
        """End points so far, and the operator's edits."""
        self._sensor = Guarded("the view of the sensor", SensorWatch(baseline), failures, "it is no longer shown")
        self._turning = Guarded("the turning rate", Turning(), failures, "it is no longer shown")
        self._withdrawn = self._runs = 0  # of the detector, as last seen
        self.newest_s = 0.0
        """Newest time on the time axis, s; 0 before the first sample."""
        self._sampled_ns: int | None = None  # when the last sample came, also one that has no place yet
        self._heard_ns = 0  # when the newest chunk was received
        self.reconnects = 0
        """How often the link was lost and opened again."""

    @property
    def n_endpoints(self) -> int:
        """End points that count so far."""
        return self.score.subject.n_endpoints

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know of who sends, a sentence each."""
        return (*self.link.problems, *self.assembler.problems)

    @property
    def refused(self) -> tuple[str, ...]:
        """What came with a right checksum and cannot be, a sentence each."""
        return self.assembler.refused

    @property
    def paused(self) -> bool:
        """Whether the next end point is long overdue: the hand rests."""
        return "pause" in self._online.flags

    @property
    def period_s(self) -> float | None:
        """The motion's period as far as known."""
        return self._detector.ask(lambda detector: detector.period_s, 0.0) or None

    @property
    def _online(self) -> OnlineState:
        return self._detector.ask(lambda detector: detector.state, NOTHING_KNOWN)

    def feed(self, chunk: AnyChunk) -> TrialUpdate:
        """Process one chunk; an empty one means that the link was opened again."""
        if chunk.data:
            self._heard_ns = chunk.host_time_ns
        update = self._feed_items(self.link.feed(chunk))
        if isinstance(chunk, GapChunk):
            self.assembler.add_gap()
        elif chunk.reopened:  # what was still held came before the cut
            self.reconnects += 1
            self.assembler.reopened()
            self._clock.ask(ClockEstimator.new_segment, None)
        return update

    def finish(self) -> TrialUpdate:
        """Process what link and assembler still hold, as the reading of a recording does at its end.

        No chunk follows: what waited for an answer counts as the object's own.
        """
        return self._feed_items(self.link.flush(), is_last=True)

    def _feed_items(self, items: list[StreamItem], *, is_last: bool = False) -> TrialUpdate:
        sampled = any(isinstance(item, OrientationBatch) for item in items)
        if sampled:
            self._sampled_ns = self._heard_ns
        cycles: list[CycleRow] = []
        self.assembler.damaged(self.link.take_damage())
        blocks = self.assembler.feed(items, self._heard_ns)
        if is_last:
            blocks += self.assembler.release()
        for block in blocks:
            cycles += self._feed_block(block)
        decoded, self._decoded = self._decoded, []
        return TrialUpdate(items, sampled, decoded, cycles)

    def feed_round_trips(self, trips: Iterable[RoundTrip]) -> None:
        """Enter answers to TIME_REQUEST in the clock estimate."""
        for trip in trips:
            self._feed_round_trip(trip)

    def _feed_round_trip(self, trip: RoundTrip) -> None:
        receive_us = self.assembler.locate_us(trip.receive_us, trip.received_ns)
        transmit_us = self.assembler.locate_us(trip.transmit_us, trip.received_ns)
        if receive_us is not None and transmit_us is not None:  # else it is of another segment
            times = trip.sent_ns, receive_us, transmit_us, trip.received_ns
            self._clock.ask(lambda clock: clock.feed_round_trip(*times), None)

    @property
    def clock_estimate(self) -> ClockEstimate | None:
        """What is known of the object's clock now; None before the first sample."""
        return self._clock.ask(ClockEstimator.estimate, None)

    def clock_values(self) -> LiveClock | None:
        """Return the live estimate of the object's clock, for a result file; None before the first sample."""
        return self._clock.ask(_account, None)

    def _map(self, samples: UnwrappedSamples) -> None:
        stamps_ns = self._clock.ask(lambda clock: clock.map(samples.device_time_us, samples.host_time_ns), None)
        if stamps_ns is None:
            stamps_ns = np.full(len(samples.device_time_us), samples.host_time_ns, dtype=np.int64)
        self._decoded.append(DecodedBatch(stamps_ns, samples.quats_wxyz))

    def _feed_block(self, block: SampleBlock) -> list[CycleRow]:
        """Show a block to all that watch the motion; return the cycles that it confirms."""
        self.newest_s = newest_s = max(self.newest_s, float(block.time_s.max()))
        self._rate.ask(lambda rate: rate.add(len(block), self._heard_ns), None)
        self._sensor.ask(lambda sensor: sensor.feed(block, newest_s), None)
        pose = float(block.time_s[-1]), block.quats_wxyz[-1]
        if self._turning.ask(lambda turning: turning.feed(*pose), False):
            self._sensor.ask(lambda sensor: sensor.feed_pose(*pose), None)
        # Samples that come late are in the recording; the detector, being causal, passes them over.
        found = self._detector.ask(lambda it: it.feed(block.time_s, block.quats_wxyz, block.index.tolist()), NONE_FOUND)
        online = self._online
        if online.withdrawn > self._withdrawn:
            self._withdrawn = online.withdrawn
            self.score.ask(RunningScore.forget, None)
        if found:
            self._sensor.ask(SensorWatch.end_rest, None)
        rows: list[CycleRow] = []
        for endpoint in found:
            # Several found at once lie in one run: only the first can have a gap before it.
            over_gap, self._runs = online.runs > self._runs > 0, online.runs
            rows += self._enter(endpoint, over_gap)
        return rows

    def _enter(self, endpoint: Endpoint, over_gap: bool) -> list[CycleRow]:
        row = self.score.ask(lambda score: score.enter(endpoint, over_gap), None)
        return [] if row is None else [row]

    def motion_view(self) -> MotionView:
        """Return the motion as the online detector sees it now."""
        online = self._online
        running = "running" if self.n_endpoints > 1 else "waiting for cycles"
        if not (self._detector.works and self.score.works):
            running = UNCOUNTED
        return MotionView(
            phase=running if self.assembler.segments else "no data",
            moving=online.moving,
            period_s=self.period_s,
            swing_deg=online.swing_deg or None,
            cycle_phase=online.phase if online.endpoints else None,
            flags=online.flags,
            turn_rate_dps=self._turning.ask(lambda turning: turning.rate_dps, None),
            peak_rate_dps=self._turning.ask(lambda turning: turning.peak_dps, None),
        )

    def sensor_view(self) -> SensorView:
        """Return what is known of the object and its sensor now."""
        info, status = self.assembler.info, self.assembler.status
        known = self.newest_s, self.period_s, self.n_endpoints
        return self._sensor.ask(lambda sensor: sensor.view(info, status, *known), SensorView())

    def stream_view(self, now_ns: int) -> StreamView:
        """Return what came over the link until ``now_ns``, monotonic (of a replay: the recording's)."""
        segments = self.assembler.segments
        return StreamView(
            rate_hz=self._rate.ask(lambda rate: rate.rate_hz(now_ns), None),
            silent_s=0.0 if self._sampled_ns is None else max(0.0, (now_ns - self._sampled_ns) / 1e9),
            n_bytes=self.link.n_bytes,
            losses=self.assembler.losses(),
            segments=len(segments),
            segment_reason=segments[-1].reason if len(segments) > 1 else "",
            reconnects=self.reconnects,
            counters=CounterView.of(self.link.counters),
        )

    def clock_view(self) -> ClockView:
        """Return how the object's clock runs against the host's, as far as known now."""
        return self._clock.ask(_clock_view, ClockView())


def _account(clock: ClockEstimator) -> LiveClock | None:
    estimate = clock.estimate()
    return None if estimate is None else estimate.account()


def _clock_view(clock: ClockEstimator) -> ClockView:
    estimate = clock.estimate()
    if estimate is None:
        return ClockView()
    return ClockView(
        skew_ppm=estimate.skew_ppm if estimate.warm else None,
        jitter_p50_ms=estimate.jitter_p50_ns / 1e6,
        jitter_p99_ms=estimate.jitter_p99_ns / 1e6,
        offset_interval_ns=estimate.interval.bounds_ns,
        warm_up_s=estimate.warm_up_s,
    )
