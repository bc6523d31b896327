"""Packets on their way from the object to the link: faults on whole packets, and late delivery."""

from __future__ import annotations

import itertools
import math
from collections import Counter, deque
from collections.abc import Sequence

import numpy as np

from emulator.faults.definitions import FaultLog, FaultSettings
from emulator.faults.frame_faults import PacketFaults
from emulator.links import Link
from firmware_protocol.packets import PacketType

_DELIVERY_STREAM = 53
_ACCEPTED_AT_ONCE = 32
_DELIVERED_AT_ONCE = 256


class Delivery:
    """What is between the object and its open link: what happens to packets there is seeded and noted in the log."""

    def __init__(self, link: Link, settings: FaultSettings, seed: int, log: FaultLog) -> None:
        self.sent: Counter[int] = Counter()
        """Packets that the link accepted, by type byte."""
        self._link, self._log = link, log
        self._faults = PacketFaults(settings, seed, log)
        self._rng = np.random.default_rng([seed, _DELIVERY_STREAM])
        self._in_flight: deque[tuple[float, bytes]] = deque()  # due, packet
        self.use(settings)

    def use(self, settings: FaultSettings) -> None:
        """Go on with other rates and delays."""
        self._faults.use(settings)
        self._interval_s = settings.delivery_interval_ms * 1e-3
        self._jitter_s = settings.delivery_jitter_ms * 1e-3

    @property
    def next_due_s(self) -> float:
        """When the next packet is to be delivered, s; infinite where none is on its way."""
        return self._in_flight[0][0] if self._in_flight else math.inf

    def send(self, packets: Sequence[bytes], now_s: float, *, faulty: bool) -> int | None:
        """Accept packets from the object; return how many, None where nobody is at the other end.

        ``faulty`` is whether the rates of faults act now.
        """
        delayed = self._interval_s + self._jitter_s > 0.0
        if not (self._faults.any or delayed or self._in_flight):
            accepted = self._link.send(packets)
            if accepted:
                self.sent.update(packet[0] for packet in packets[:accepted])
            return accepted
        if self._link.send(()) is None:  # nobody there
            self.lose(now_s)
            return None
        self.deliver(now_s)
        if self.next_due_s <= now_s:  # the link is full
            return 0
        accepted = min(len(packets), _ACCEPTED_AT_ONCE)
        for packet in self._faults.apply(packets[:accepted], now_s, active=faulty):
            self._in_flight.append((self._due_s(now_s) if delayed else now_s, packet))
        self.deliver(now_s)
        return accepted

    def _due_s(self, now_s: float) -> float:
        """Return when a packet is delivered: at the next poll, late by chance, never before an earlier one."""
        due_s = now_s
        if self._interval_s:
            due_s = math.ceil(due_s / self._interval_s) * self._interval_s
        last_s = self._in_flight[-1][0] if self._in_flight else 0.0
        if due_s <= last_s:
            return last_s
        return due_s + self._rng.random() * self._jitter_s

    def deliver(self, now_s: float) -> None:
        """Hand the link what is due."""
        while self.next_due_s <= now_s:
            due = [packet for due_s, packet in itertools.islice(self._in_flight, _DELIVERED_AT_ONCE) if due_s <= now_s]
            accepted = self._link.send(due)
            if accepted is None:
                self.lose(now_s)
            if not accepted:
                return
            for _ in range(accepted):
                self.sent[self._in_flight.popleft()[1][0]] += 1

    def lose(self, now_s: float) -> None:
        """Lose what is on its way: the line was cut. The log keeps how many samples."""
        self._faults.forget()
        samples = sum(packet[0] == PacketType.ORIENTATION for _, packet in self._in_flight)
        if samples:
            self._log.add("lost-in-flight", now_s, samples)
        self._in_flight.clear()
