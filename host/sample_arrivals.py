"""When each sample of a recording arrived: what the clock's offline pass needs and joined chunks no longer tell.

A recording is decoded in joined chunks, because a chunk of one sample costs as much as one of a hundred. Which sample
came with which of the chunks joined is found by where their frames end: without decoding anything twice.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_protocol.batch import ORIENTATION_BYTES
from firmware_protocol.errors import MalformedPacketError
from firmware_protocol.packets import Info, OrientationBatch
from firmware_protocol.serial_framing import CRC_BYTES, MAX_PIECE_BYTES, FrameDecoder
from firmware_protocol.stream import StreamItem
from host.clock_remap import RemappedClock, remap
from host.transports.chunks import AnyChunk, FrameChunk

IntArray = npt.NDArray[np.int64]

PIECE_BYTES = ORIENTATION_BYTES + CRC_BYTES + 1
"""Of a sample's frame between its delimiters."""
MAX_CHUNKS = 200_000
"""Longer recordings are thinned to about so many arrivals: still hundreds in every second that matters."""


class SampleArrivals:
    """Gathers device time and arrival of the samples of one recording."""

    def __init__(self) -> None:
        self._pending = b""  # of the frame begun in an earlier chunk
        self._ticks: list[IntArray] = []
        self._arrivals: list[IntArray] = []
        self._n = 0
        self._starts: list[int] = []
        self._boot_id: int | None = None
        self.n_unplaced = 0
        """Samples whose chunk could not be told; they are left out here."""

    def feed(self, parts: list[AnyChunk], items: Iterable[StreamItem]) -> None:
        """Take chunks that were decoded together, and what they gave.

        Parameters
        ----------
        parts : list of AnyChunk
            In order.
        items : iterable of StreamItem
            As the link decoded them.
        """
        if not parts[0].data:  # the link was opened again
            self._pending = b""
            self._starts.append(self._n)
            self.leave_out(items)
            return
        samples = []
        starts = []
        n = 0
        for item in items:
            if isinstance(item, OrientationBatch):
                samples.append(item.device_time_us.astype(np.int64))
                n += len(item)
            elif isinstance(item, Info):
                if self._boot_id is not None and item.boot_id != self._boot_id:
                    starts.append(n)
                self._boot_id = item.boot_id
        is_can = isinstance(parts[0], FrameChunk)
        arrivals = _frame_arrivals(parts, n) if is_can else self._byte_arrivals(parts, n)
        if arrivals is None:
            self.n_unplaced += n
            self._starts += [self._n] * len(starts)
            return
        self._starts += [self._n + start for start in starts]
        self._n += n
        self._ticks += samples
        self._arrivals.append(arrivals)

    def leave_out(self, items: Iterable[StreamItem]) -> None:
        """Count samples that the decoder held to the end: by then their chunk is not known any more."""
        self.n_unplaced += sum(len(item) for item in items if isinstance(item, OrientationBatch))

    def remapped(self) -> RemappedClock | None:
        """Run the clock's offline pass; None where no sample's arrival is known."""
        if not self._n:
            return None
        ticks = np.concatenate(self._ticks)
        arrivals = np.maximum.accumulate(np.concatenate(self._arrivals))
        starts = np.array(self._starts, dtype=np.int64)
        step = 1 + len(np.unique(arrivals)) // MAX_CHUNKS
        if step > 1:
            chunk = np.cumsum(np.diff(arrivals, prepend=arrivals[0]) > 0)
            keep = np.flatnonzero(chunk % step == 0)
            ticks, arrivals, starts = ticks[keep], arrivals[keep], np.searchsorted(keep, starts)
        return remap(ticks, arrivals, np.unique(starts).tolist())

    def _byte_arrivals(self, parts: list[AnyChunk], n: int) -> IntArray | None:
        """Give each sample the chunk that brought the delimiter behind it; None if they cannot be told apart."""
        before = len(self._pending)
        data = self._pending + b"".join(part.data for part in parts)
        delimiters = np.flatnonzero(np.frombuffer(data, np.uint8) == 0)
        last = int(delimiters[-1]) + 1 if len(delimiters) else 0
        self._pending = data[last:][-MAX_PIECE_BYTES:]
        lengths = np.diff(delimiters, prepend=-1) - 1
        ends = delimiters[lengths == PIECE_BYTES]
        if len(ends) != n:  # damaged ones among them
            ends = np.array([end for end in ends.tolist() if _is_frame(data[end - PIECE_BYTES : end])], dtype=np.int64)
            if len(ends) != n:
                return None
        sizes = np.cumsum([len(part.data) for part in parts]) + before
        times = np.array([part.host_time_ns for part in parts], dtype=np.int64)
        arrived: IntArray = times[np.searchsorted(sizes, ends, side="right")]
        return arrived


def _is_frame(piece: bytes) -> bool:
    return bool(FrameDecoder().unframe(piece + b"\0"))


def _frame_arrivals(parts: list[AnyChunk], n: int) -> IntArray | None:
    """Give each sample the time of its own CAN frame; None if they cannot be told apart."""
    from firmware_protocol.can_frames import frame_array
    from firmware_protocol.can_mapping import FD_BIT, NODE_BITS, CanFunction

    times: list[Any] = []
    for part in parts:
        try:
            records = frame_array(part.data)
        except MalformedPacketError:
            return None
        function = (records["arbitration_id"] & ~np.uint32(FD_BIT)) >> NODE_BITS
        times.append(records["host_time_ns"][(function == CanFunction.ORIENTATION) & (records["flags"] & 0x39 == 0)])
    arrived: IntArray = np.concatenate(times).astype(np.int64)
    return arrived if len(arrived) == n else None


def clock_values(clock: RemappedClock | None, n_unplaced: int) -> dict[str, Any] | None:
    """Lay out what the offline pass found, for a result file; None where it found nothing."""
    if clock is None:
        return None
    longest = max(clock.segments, key=lambda segment: segment.n_chunks)
    return {
        "skew_ppm": longest.skew_ppm,
        "jitter_p50_ms": longest.jitter_p50_ns / 1e6,
        "jitter_p99_ms": longest.jitter_p99_ns / 1e6,
        "window_s": longest.window_s,
        "bursty": longest.bursty,
        "arrivals": sum(segment.n_chunks for segment in clock.segments),
        "samples_unplaced": n_unplaced,
        "segments": [
            {"samples": segment.stop - segment.start, "skew_ppm": segment.skew_ppm} for segment in clock.segments
        ],
        "steps": [{"by_s": step.disagreement_us / 1e6, "gap_s": step.gap_ns / 1e9} for step in clock.steps],
    }
