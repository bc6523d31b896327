"""A trial as it happens: chunks in, cycles and a running score out, with bounded memory.

The same object runs under a live capture and under a replay. What it says is provisional: the result is made from the
whole recording afterwards (:mod:`host.results.result`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from analysis.cycles.online.detector import OnlineCycleDetector
from analysis.geometry import rotations
from analysis.scoring.trust import MIN_REST_FOR_FLOOR_S
from analysis.sensor.baseline import StaticBaseline
from firmware_protocol.items import StreamItem
from firmware_protocol.packets import Event, Info, OrientationBatch, OrientationFlag, Status
from host.clock.device_clock import ClockEstimate, DeviceClock
from host.links.transport import AnyChunk
from host.stream.blocks import SampleBlock
from host.stream.decoding import Link
from host.stream.rate import RateMeter
from host.stream.samples import SampleAssembler
from host.stream.session import RoundTrip
from host.text import plain
from host.trial.first_rest import FirstRest
from host.trial.running_score import RunningScore
from host.trial.state import ClockView, CounterView, CycleRow, MotionView, SensorView, StreamView

TURN_S = 0.5
"""Stretch over which the turning rate is taken."""
PEAK_S = 1.0
"""How long the fastest turn is kept: longer than from one picture to the next."""
SATURATION_S = 1.0
"""How long a saturated sample is shown."""


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
    decoded: list[DecodedBatch]
    cycles: list[CycleRow] = field(default_factory=list)
    """Cycles confirmed by this chunk."""
    events: list[tuple[Event, float | None]] = field(default_factory=list)
    """Events with their place on the time axis, s."""


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
        self._clock = DeviceClock()
        self._detector = OnlineCycleDetector()
        self._rate = RateMeter()
        self.score = RunningScore(target_half_width_deg)
        """End points so far, and the operator's edits."""
        self._baseline = baseline
        self._rest: FirstRest | None = FirstRest() if baseline is None else None
        self._floor_known = baseline is not None  # a short rest tells the drift, but no floor
        self._recent: deque[tuple[float, npt.NDArray[np.float64]]] = deque(maxlen=64)
        self._peak = (-np.inf, 0.0)  # when the object turned fastest of late, and how fast, deg/s
        self._saturated_s = -np.inf
        self._withdrawn = self._runs = 0
        self._newest_s = 0.0
        self._last_block: SampleBlock | None = None
        self._sampled_ns: int | None = None  # when the last sample came, also one that has no place yet
        self._heard_ns = 0  # when the newest chunk was received
        self.reconnects = 0
        """How often the link was lost and opened again."""

    @property
    def n_endpoints(self) -> int:
        """End points that count so far."""
        return self.score.n_endpoints

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know of who sends, a sentence each."""
        return (*self.link.problems, *self.assembler.problems)

    @property
    def paused(self) -> bool:
        """Whether the next end point is long overdue: the hand rests."""
        return "pause" in self._detector.state.flags

    @property
    def period_s(self) -> float | None:
        """The motion's period as far as known."""
        return self._detector.period_s or None

    @property
    def newest_s(self) -> float:
        """Newest time on the time axis, s; 0 before the first sample."""
        return self._newest_s

    def feed(self, chunk: AnyChunk) -> TrialUpdate:
        """Take one chunk; an empty one says that the link was opened again."""
        if chunk.data:
            self._heard_ns = chunk.host_time_ns
        update = self._feed_items(self.link.feed(chunk))
        if not chunk.data:  # what was still held came before the cut
            self.reconnects += 1
            self.assembler.reopened()
            self._clock.new_segment()
        return update

    def finish(self) -> TrialUpdate:
        """Take what the link still holds: no chunk follows."""
        return self._feed_items(self.link.flush())

    def _feed_items(self, items: list[StreamItem]) -> TrialUpdate:
        decoded = self._feed_clock(items, self._heard_ns)
        if decoded:
            self._sampled_ns = self._heard_ns
        cycles: list[CycleRow] = []
        self.assembler.damaged(self.link.take_damage())
        for block in self.assembler.feed(items, self._heard_ns):
            self._rate.add(len(block), self._heard_ns)
            self._last_block = block
            cycles += self._feed_block(block)
        events = [(item, self.assembler.locate_s(item, self._heard_ns)) for item in items if isinstance(item, Event)]
        return TrialUpdate(items, decoded, cycles, events)

    def feed_round_trips(self, trips: Iterable[RoundTrip]) -> None:
        """Take answers to TIME_REQUEST into the clock estimate."""
        for trip in trips:
            self._clock.feed_round_trip(trip.sent_ns, trip.receive_us, trip.transmit_us, trip.received_ns)

    def motion_view(self) -> MotionView:
        """Return the motion as the online detector sees it now."""
        online = self._detector.state
        return MotionView(
            phase=self._motion_phase(),
            moving=online.moving,
            period_s=self.period_s,
            swing_deg=online.swing_deg or None,
            cycle_phase=online.phase if online.endpoints else None,
            flags=online.flags,
            turn_rate_dps=self._turn_rate_dps(),
            peak_rate_dps=self._peak[1] if self._recent else None,
        )

    @property
    def clock_estimate(self) -> ClockEstimate | None:
        """What is known of the object's clock now; None before the first sample."""
        return self._clock.estimate()

    def clock_values(self) -> dict[str, Any] | None:
        """Lay out the live estimate of the object's clock, for a result file; None before the first sample."""
        estimate = self._clock.estimate()
        if estimate is None:
            return None
        interval = _interval(estimate)
        return {
            "segments": self._clock.segment + 1,
            "skew_ppm": estimate.skew_ppm if estimate.warm else None,
            "skew_uncertainty_ppm": _number(estimate.skew_uncertainty_ppm),
            "offset_interval_ms": None if interval is None else [bound / 1e6 for bound in interval],
            "offset_uncertainty_ms": (interval[1] - interval[0]) / 1e6 if interval and estimate.consistent else None,
            "consistent": estimate.consistent,
            "round_trips": estimate.n_round_trips,
            "jitter_p50_ms": _number(estimate.jitter_p50_ns / 1e6),
            "jitter_p99_ms": _number(estimate.jitter_p99_ns / 1e6),
            "warm_up_s": estimate.warm_up_s,
            "bursty": estimate.bursty,
        }

    def _feed_clock(self, items: list[StreamItem], host_time_ns: int) -> list[DecodedBatch]:
        decoded = []
        for item in items:
            if isinstance(item, OrientationBatch):
                mapped = self._clock.feed(item.device_time_us, host_time_ns)
                decoded.append(DecodedBatch(mapped.host_time_ns, item.quats_wxyz))
            elif isinstance(item, Info):
                self._clock.boot(item.boot_id)
        return decoded

    def _feed_block(self, block: SampleBlock) -> list[CycleRow]:
        self._newest_s = max(self._newest_s, float(block.time_s.max()))
        self._look_at_rate(float(block.time_s[-1]), block.quats_wxyz[-1])
        if np.any(block.flags & OrientationFlag.SATURATED):
            self._saturated_s = self._newest_s
        # Samples that come late are in the recording; the detector, being causal, passes them over.
        found = self._detector.feed(block.time_s, block.quats_wxyz, block.index.tolist())
        withdrawn = self._detector.state.withdrawn
        if withdrawn > self._withdrawn:
            self._withdrawn = withdrawn
            self.score.forget()
        if found and self._rest is not None:
            self._baseline, self._rest = self._rest.baseline(), None
            self._floor_known = self._baseline is not None and self._baseline.duration_s >= MIN_REST_FOR_FLOOR_S
        rows = []
        for endpoint in found:
            # Several found at once lie in one run: only the first can have a gap before it.
            rows.append(self.score.enter(endpoint, over_gap=self._detector.state.runs > self._runs > 0))
            self._runs = self._detector.state.runs
        return rows

    def _look_at_rate(self, time_s: float, quat: npt.NDArray[np.float64]) -> None:
        """Keep a pose now and then, and the fastest turn between two of them."""
        if self._recent:
            before_s, before = self._recent[-1]
            if time_s - before_s < TURN_S / 16:
                return
            rate_dps = float(np.degrees(rotations.distance(quat, before))) / (time_s - before_s)
            if time_s - self._peak[0] > PEAK_S or rate_dps > self._peak[1]:
                self._peak = (time_s, rate_dps)
        self._recent.append((time_s, quat))
        if self._rest is not None:
            self._rest.feed(time_s, quat)

    def _turn_rate_dps(self) -> float | None:
        """Mean turning rate over the last half second, deg/s."""
        if len(self._recent) < 2:
            return None
        time_s, quat = self._recent[-1]
        since_s, before = next(((t, q) for t, q in self._recent if time_s - t <= TURN_S), self._recent[-1])
        if time_s <= since_s:
            return None
        return float(np.degrees(rotations.distance(quat, before))) / (time_s - since_s)

    def _floor_deg(self) -> float | None:
        period_s = self.period_s
        if self._baseline is None or period_s is None or not self._floor_known:
            return None
        return self._baseline.detectable_deg(period_s, max(2, self.n_endpoints))

    def _motion_phase(self) -> str:
        if self._last_block is None:
            return "no data"
        return "running" if self.n_endpoints > 1 else "waiting for cycles"

    def sensor_view(self) -> SensorView:
        """Return what is known of the object and its sensor now."""
        info, status, block = self.assembler.info, self.assembler.status, self._last_block
        flags = OrientationFlag(int(block.flags[-1])) if block is not None else None
        w, x, y, z = (None,) * 4 if block is None else map(float, block.quats_wxyz[-1])
        return SensorView(
            name="" if info is None else plain(info.name, 32),
            device_id="" if info is None else f"{info.device_id:016x}",
            still=None if flags is None else OrientationFlag.STILL in flags,
            saturated=self._newest_s - self._saturated_s < SATURATION_S,
            calibrated=None if flags is None else OrientationFlag.CALIBRATED in flags,
            temperature_c=_number(status.temperature_c) if isinstance(status, Status) else None,
            battery_v=status.battery_mv / 1000 if isinstance(status, Status) and status.battery_mv else None,
            heading_deg_per_min=None if self._baseline is None else self._baseline.total_rate_deg_per_min,
            floor_deg=self._floor_deg(),
            orientation_wxyz=None if w is None or x is None or y is None or z is None else (w, x, y, z),
        )

    def stream_view(self, now_ns: int) -> StreamView:
        """Return what came over the link until ``now_ns``, monotonic (of a replay: the recording's)."""
        segments = self.assembler.segments
        return StreamView(
            rate_hz=self._rate.rate_hz(now_ns),
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
        estimate = self._clock.estimate()
        if estimate is None:
            return ClockView()
        return ClockView(
            skew_ppm=estimate.skew_ppm if estimate.warm else None,
            jitter_p50_ms=_number(estimate.jitter_p50_ns / 1e6),
            jitter_p99_ms=_number(estimate.jitter_p99_ns / 1e6),
            offset_interval_ns=_interval(estimate),
            warm_up_s=estimate.warm_up_s,
        )


def _interval(estimate: ClockEstimate) -> tuple[float, float] | None:
    low_ns = estimate.offset_low_ns
    return None if low_ns is None else (low_ns, estimate.offset_high_ns)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
