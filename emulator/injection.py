"""A virtual object, its link, and what goes wrong between them.

The injector stands between firmware and link for every run; without faults it only counts what is sent. Steps are split
at the instants of timed faults, so that a run has the same faults however it is stepped.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections import Counter, deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from emulator.faults.definitions import FaultLog, FaultSettings, LiveFault, RateChange, TimedFault
from emulator.faults.frame_faults import ByteFaults, PacketFaults
from emulator.links import Link
from emulator.links.byte_stream import ByteLink
from emulator.second_object import SecondObject
from emulator.virtual_object import VirtualObject
from firmware_protocol.packets import PacketType

__all__ = ["FaultInjector"]

_DELIVERY_STREAM, _COMMAND_STREAM = 53, 54
_TAKEN_AT_ONCE = 32


class FaultInjector:
    """Runs a virtual object on an open link, with the faults of its scenario.

    Parameters
    ----------
    virtual_object
        The object.
    link
        Open.

    Attributes
    ----------
    log
        Every fault that happened.
    """

    def __init__(self, virtual_object: VirtualObject, link: Link) -> None:
        self._object, self._link = virtual_object, link
        self._settings = virtual_object.scenario.faults
        seed = virtual_object.seed
        self.log = FaultLog()
        self._packet_faults = PacketFaults(self._settings, seed, self.log)
        self._byte_faults = ByteFaults(self._settings, seed, self.log)
        self._second: SecondObject | None = None
        self._delivery_rng = np.random.default_rng([seed, _DELIVERY_STREAM])
        self._command_rng = np.random.default_rng([seed, _COMMAND_STREAM])
        self._sent: Counter[int] = Counter()
        self._now_s = 0.0
        self._scheduled = False
        self._events: list[tuple[float, int, Callable[[], None]]] = []  # heap: when, order, what
        self._order = itertools.count()
        self._stalls = self._unplugs = self._floods = 0
        self._rates_active = False
        self._in_flight: deque[tuple[float, bytes]] = deque()  # due, packet
        self._rates_changed = 0
        self._use(self._settings)

    # --- time ----------------------------------------------------------------------------------------------------

    def step(self, now_s: float) -> None:
        """Do all that is due by now; times never decrease."""
        self._schedule()
        while self._events and self._events[0][0] <= now_s:
            time_s, _, action = heapq.heappop(self._events)
            self._step_to(time_s)
            action()
        self._step_to(now_s)

    def _step_to(self, now_s: float) -> None:
        # With a second object on the line they take turns, in the order in which they have something to say.
        while self._second is not None and (due_s := min(self._object.next_due_s, self._second.next_due_s)) < now_s:
            self._step_both(due_s)
        self._step_both(now_s)

    def _step_both(self, now_s: float) -> None:
        self._now_s = self._byte_faults.now_s = max(now_s, self._now_s)
        self._object.step(self._now_s, self._send)
        if self._second is not None:
            self._second.step(self._now_s, self._send_second)
        self._deliver()

    @property
    def next_due_s(self) -> float:
        """When :meth:`step` has something to do next, if no command comes, s."""
        due_s = self._object.next_due_s
        if self._second is not None:
            due_s = min(due_s, self._second.next_due_s)
        if self._events:
            due_s = min(due_s, self._events[0][0])
        if self._in_flight:
            due_s = min(due_s, self._in_flight[0][0])
        return due_s

    @property
    def backlog(self) -> int:
        """Packets that wait because the link takes nothing."""
        return self._object.firmware.backlog + self._overdue

    def _schedule(self) -> None:
        """Put the scenario's faults into time once the hand's timeline has begun."""
        start_s = self._object.hand_start_s
        if self._scheduled or start_s is None:
            return
        self._scheduled = True
        self._plan(start_s + self._settings.rates_from_s, partial(self._set_rates, active=True))
        self._plan(start_s + self._settings.rates_until_s, partial(self._set_rates, active=False))
        for fault in self._settings.at:
            self._plan(start_s + fault.at_s, partial(self._begin, fault))

    def _plan(self, time_s: float, action: Callable[[], None]) -> None:
        heapq.heappush(self._events, (time_s, next(self._order), action))

    def inject(self, fault: LiveFault) -> None:
        """Let a fault happen at the next step, whatever its ``at_s``: a live command."""
        if isinstance(fault, RateChange):
            self._plan(self._now_s, partial(self._change_rates, fault))
        else:
            self._plan(self._now_s, partial(self._begin, fault))

    # --- commands and packets ------------------------------------------------------------------------------------

    def receive(self, now_s: float) -> None:
        """Pass on the commands that have arrived, after :meth:`step` up to now."""
        self.obey(self.collect(), now_s)

    def collect(self) -> list[bytes]:
        """Take the commands that have arrived off the link, without doing anything with them."""
        return self._link.receive() if not self._unplugs else []

    def obey(self, commands: Sequence[bytes], now_s: float) -> None:
        """Pass commands on to the object, after :meth:`step` up to now."""
        for command in commands:
            chance = self._settings.command_loss_probability
            if chance and self._command_rng.random() < chance:
                self.log.add("command-loss", now_s, command_type=command[0] if command else None)
            else:
                self._object.receive(command, now_s)
                if self._second is not None:
                    self._second.receive(command, now_s)

    def _send(self, packets: Sequence[bytes]) -> int | None:
        """Take packets from the firmware: the sink of its queue."""
        if self._unplugs:
            return None
        if self._stalls:
            return 0
        if not (self._packet_faults.any or self._delayed or self._in_flight):
            taken = self._link.send(packets)
            if taken:
                self._sent.update(packet[0] for packet in packets[:taken])
            return taken
        if self._link.send(()) is None:  # nobody there
            self._forget_in_flight()
            return None
        self._deliver()
        if self._overdue:  # the link is full
            return 0
        taken = min(len(packets), _TAKEN_AT_ONCE)
        for packet in self._packet_faults.apply(packets[:taken], self._now_s, active=self._rates_active):
            self._in_flight.append((self._due_s(), packet))
        self._deliver()
        return taken

    def _send_second(self, packets: Sequence[bytes]) -> int | None:
        """Take packets from a second object; nothing happens to them on the way."""
        if self._unplugs:
            return None
        if self._stalls or self._in_flight:
            return 0
        return self._link.send(packets)

    @property
    def _overdue(self) -> bool:
        return bool(self._in_flight) and self._in_flight[0][0] <= self._now_s

    def _due_s(self) -> float:
        """When a packet handed over now is delivered: at the next poll, late by chance, never before an earlier one."""
        if not self._delayed:
            return self._now_s
        due_s, interval_s = self._now_s, self._settings.delivery_interval_ms * 1e-3
        if interval_s:
            due_s = np.ceil(due_s / interval_s) * interval_s
        last_s = self._in_flight[-1][0] if self._in_flight else 0.0
        if due_s <= last_s:
            return last_s
        return float(due_s + self._delivery_rng.random() * self._settings.delivery_jitter_ms * 1e-3)

    def _deliver(self) -> None:
        """Give the link what is due."""
        while self._in_flight and self._in_flight[0][0] <= self._now_s and not self._stalls:
            due = [packet for due_s, packet in itertools.islice(self._in_flight, 256) if due_s <= self._now_s]
            taken = self._link.send(due)
            if taken is None:
                self._forget_in_flight()
            if not taken:
                return
            for _ in range(taken):
                self._sent[self._in_flight.popleft()[1][0]] += 1

    def _forget_in_flight(self) -> None:
        """Lose what is on its way: the line was cut. The log says how many samples."""
        self._packet_faults.forget()
        samples = sum(packet[0] == PacketType.ORIENTATION for _, packet in self._in_flight)
        if samples:
            self.log.add("lost-in-flight", self._now_s, samples)
        self._in_flight.clear()

    # --- timed faults --------------------------------------------------------------------------------------------

    def _set_rates(self, *, active: bool) -> None:
        self._rates_active = self._byte_faults.active = active

    def _use(self, settings: FaultSettings) -> None:
        self._settings = settings
        self._packet_faults.use(settings)
        self._byte_faults.use(settings)
        if isinstance(self._link, ByteLink) and self._byte_faults.any:
            self._link.tamper = self._byte_faults
        self._delayed = settings.delivery_interval_ms + settings.delivery_jitter_ms > 0.0

    def _change_rates(self, change: RateChange) -> None:
        """Set rates while the object runs; the latest change counts."""
        own, was_active = self._object.scenario.faults, self._rates_active
        self._rates_changed += 1
        self._use(change.apply(own))
        self._set_rates(active=True)
        details: dict[str, Any] = dict(change.values)
        self.log.add("rates", self._now_s, **details)
        if change.for_s < math.inf:
            self._plan(self._now_s + change.for_s, partial(self._restore_rates, self._rates_changed, was_active))

    def _restore_rates(self, number: int, active: bool) -> None:
        if number == self._rates_changed:
            self._use(self._object.scenario.faults)
            self._set_rates(active=active)

    def _begin(self, fault: TimedFault) -> None:
        now_s, firmware = self._now_s, self._object.firmware
        if fault.kind == "stall":
            self._stalls += 1
            self.log.add("stall", now_s, for_s=fault.for_s)
        elif fault.kind == "unplug":
            self._unplug()
            self.log.add("unplug", now_s, for_s=fault.for_s)
        elif fault.kind == "reset":
            firmware.reset(now_s, fault.for_s)
            self.log.add("reset", now_s, for_s=fault.for_s)
        elif fault.kind == "swap":
            self._unplug()
            firmware.become_another(now_s, fault.for_s)
            self.log.add("swap", now_s, for_s=fault.for_s, device_id=firmware.settings.device_id)
        elif fault.kind == "wrong-version":
            firmware.speak_version(fault.major, now_s, fault.for_s)
            self.log.add("wrong-version", now_s, for_s=fault.for_s, major=fault.major)
        elif fault.kind == "second-object":
            self._second = SecondObject(self._object, now_s)
            self.log.add("second-object", now_s, for_s=fault.for_s, device_id=self._second.device_id)
        elif fault.kind == "clock-step":
            firmware.step_clock(now_s, round(fault.by_s * 1e6))
            self.log.add("clock-step", now_s, by_s=fault.by_s)
        elif fault.kind == "flood":
            self._floods += 1
            firmware.set_true_rate(max(round(firmware.rate_hz * fault.factor), 1), now_s)
            self.log.add("flood", now_s, for_s=fault.for_s, factor=fault.factor)
        elif fault.kind == "garbage" and isinstance(self._link, ByteLink):
            self._link.inject(self._byte_faults.garbage(fault.count))
            self.log.add("garbage", now_s, fault.count)
        if fault.kind in ("stall", "unplug", "swap", "flood", "second-object"):
            self._plan(now_s + fault.for_s, partial(self._end, fault))

    def _end(self, fault: TimedFault) -> None:
        if fault.kind == "stall":
            self._stalls -= 1
        elif fault.kind == "second-object":
            self._second = None
        elif fault.kind == "flood":
            self._floods -= 1
            if not self._floods:
                self._object.firmware.set_true_rate(self._object.firmware.rate_hz, self._now_s)
        else:
            self._unplugs -= 1
            if not self._unplugs:
                self._link.replug()

    def _unplug(self) -> None:
        if not self._unplugs:
            self._link.unplug()
            self._forget_in_flight()
        self._unplugs += 1

    # --- truth ---------------------------------------------------------------------------------------------------

    def truth(self) -> dict[str, Any]:
        """Return what was sent and what went wrong, ready for JSON."""
        names = {int(packet_type): packet_type.name for packet_type in PacketType}
        return {
            "sent": {names[each]: count for each, count in sorted(self._sent.items())},
            "frames_damaged": dict(sorted(self._byte_faults.damaged.items())),
            "fault_counts": dict(sorted(self.log.counts.items())),
            "faults": list(self.log.entries),
        }
