"""The object's transmit queue: bounded, first in first out, whole packets; what does not fit is dropped and counted."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import TypeAlias

Sink: TypeAlias = Callable[[Sequence[bytes]], int | None]
"""Is offered encoded packets in order; returns how many it accepted: 0 when full, None with nobody at the other end."""

LatePacket: TypeAlias = Callable[[float], bytes]
"""Encoded only when the link accepts it, with the time of that moment."""

_OFFERED_AT_ONCE = 256
_REPLY_RESERVE_BYTES = 1024
_LATE_BYTES = 32  # no packet that is encoded late is longer


class TransmitQueue:
    """Packets on their way to the link: room for samples, and a small reserve beyond it for replies."""

    def __init__(self, capacity_bytes: int) -> None:
        self.capacity_bytes = capacity_bytes
        self.samples_dropped = 0
        """Samples dropped since boot: no room, or nobody there."""
        self.dropped_before = 0
        """Samples dropped in all boots before."""
        self._items: deque[tuple[bytes | LatePacket, int, bool]] = deque()  # packet, its size, is the head of a sample
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._items)

    @property
    def is_full(self) -> bool:
        """Whether there is no room left for samples."""
        return self._bytes >= self.capacity_bytes

    def put(self, packet: bytes | LatePacket) -> bool:
        """Queue a packet other than a sample; False if even the reserve is used up."""
        size = len(packet) if isinstance(packet, bytes) else _LATE_BYTES
        if self._bytes + size > self.capacity_bytes + _REPLY_RESERVE_BYTES:
            return False
        self._items.append((packet, size, False))
        self._bytes += size
        return True

    def put_samples(self, samples: Sequence[tuple[bytes, ...]], now_s: float, sink: Sink) -> None:
        """Queue samples, each one or two packets that stay together; makes room through the link before dropping."""
        stuck = False
        for sample in samples:
            size = sum(map(len, sample))
            if self._bytes + size > self.capacity_bytes and not stuck:
                self.drain(now_s, sink)
                stuck = self._bytes + size > self.capacity_bytes
            if stuck:
                self.samples_dropped += 1
                continue
            for k, packet in enumerate(sample):
                self._items.append((packet, len(packet), k == 0))
            self._bytes += size

    def drain(self, now_s: float, sink: Sink) -> None:
        """Hand the link what it accepts; with nobody at the other end everything is dropped and samples counted."""
        while self._items:
            offered = [
                item if isinstance(item, bytes) else item(now_s)
                for item, _, _ in (self._items[k] for k in range(min(len(self._items), _OFFERED_AT_ONCE)))
            ]
            accepted = sink(offered)
            if accepted is None:
                self.samples_dropped += sum(is_sample for _, _, is_sample in self._items)
                self.forget_items()
                return
            for _ in range(accepted):
                _, size, _ = self._items.popleft()
                self._bytes -= size
            if accepted == 0:
                return

    def forget_items(self) -> None:
        """Empty the queue without counting."""
        self._items.clear()
        self._bytes = 0

    def reset(self) -> None:
        """Empty the queue and start to count again: the object was reset."""
        self.forget_items()
        self.dropped_before += self.samples_dropped
        self.samples_dropped = 0
