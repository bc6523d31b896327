"""The device's uint32 microsecond clock without its wrap, with the host clock's help.

The device clock wraps every 71.58 min. Counting decreases goes wrong with every reordered sample, every gap longer
than a wrap and every reset, so each sample is placed on its own: the host clock predicts what an *instantly delivered*
sample would read, and the sample is the latest reading of that value that is not beyond the prediction. It may be
earlier than predicted, because samples arrive late, but hardly later, because nothing arrives before it is sent.

What neither lateness nor the skew of the two clocks explains is not guessed at: it is left to the caller, who starts a
new *segment* there.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from firmware_protocol.packets import DEVICE_CLOCK_MODULUS_US

IntArray = npt.NDArray[np.int64]
Number = TypeVar("Number", bound=np.integer[Any])


MAX_SKEW_PPM = 500.0
"""Largest difference in rate of the two clocks; crystals stay below 200 ppm, so an hour's gap allows 1.8 s."""
MAX_AHEAD_S = 1.0
"""How far a sample may be ahead of the prediction at no gap: a backlog that was there from the start and drains."""
MAX_LATENCY_S = 60.0
"""How late a sample may arrive: a stalled link that delivers afterwards what it kept."""
MAX_REORDER_S = 0.5
"""How far a sample may be before the newest one received: reordering, five samples at 10 Hz."""
SETTLE_S = 5.0
"""For so long after a segment's start, or after a gap beyond :data:`MAX_LATENCY_S`, that takes the place of
:data:`MAX_AHEAD_S`: the first chunks may all be late ..."""
SETTLE_CHUNKS = 20
"""... and for at least so many chunks."""


def changes(values: npt.NDArray[Number], before: int) -> npt.NDArray[Number]:
    """Differences (n,) of each value to the one before, as ``np.diff`` with ``prepend``, in a fraction of its time.

    Unsigned ones wrap.
    """
    found = np.empty_like(values)
    np.subtract(values[:1], values.dtype.type(before), out=found[:1])
    np.subtract(values[1:], values[:-1], out=found[1:])
    return found


class ClockUnwrapper:
    """Unwraps ``device_time_us`` chunk by chunk; one for each object on a link.

    It only finds how far a chunk is explained. Whether what nothing explains is a reset, a step or another object, the
    caller decides (:class:`host.stream.samples.SampleAssembler`, and no one else), and calls :meth:`new_segment`.

    Wrong only if the two clocks part by more than the stated bounds, or if a reset brings the clock, by chance, to
    within these bounds of where it would have been.

    A sample is explained when it is at most ``MAX_AHEAD_S + MAX_SKEW_PPM * age`` ahead of the prediction, at most
    ``MAX_LATENCY_S + MAX_SKEW_PPM * age`` behind it, and at most ``MAX_REORDER_S`` before the newest sample so far.
    ``age`` is the host time since the reference, the last chunk that came with (nearly) the least delay so far: that is
    the gap, or little more.
    """

    def __init__(self) -> None:
        self.newest_us: int | None = None
        """Newest unwrapped device time of this segment, us; None before its first sample."""
        self._start_ns = 0  # host time of the chunk with which settling began
        self._chunks = 0  # since then
        self._last_ns = 0  # host time of the previous chunk
        self._delay_us = 0.0  # (host - device) of the reference, the least up to the skew allowed since
        self._reference_ns = 0  # its host time

    def new_segment(self) -> None:
        """Forget the reference: the next sample is not compared with those before it."""
        self.newest_us = None

    def unwrap(self, device_time_us: npt.ArrayLike, host_time_ns: int) -> IntArray:
        """Unwrap the samples of one chunk, up to the first that nothing explains.

        A segment's first reading is kept as it is, so it starts within [0, 2**32) us.

        Parameters
        ----------
        device_time_us : (n,) uint32
            Device clock of the samples in order of reception; n may be 0.
        host_time_ns : int
            Reception of the chunk, ``time.monotonic_ns()``.

        Returns
        -------
        (k,) int64
            Unwrapped device time of the first k samples, us; these are taken into account. Where k < n, the clock jumps
            at sample k.

        Raises
        ------
        ValueError
            ``device_time_us`` is not one-dimensional.
        """
        ticks = np.asarray(device_time_us, dtype=np.int64)
        if ticks.ndim != 1:
            raise ValueError(f"device_time_us must be one-dimensional, not {ticks.shape}")
        if not len(ticks):
            return ticks
        if self.newest_us is None:
            self._start_ns = self._last_ns = self._reference_ns = host_time_ns
            self._chunks = 0
            self.newest_us = int(ticks[0])
            self._delay_us = 1e-3 * host_time_ns - self.newest_us
        # What a stalled link kept comes late, as at the start: it settles again.
        stalled = host_time_ns - self._last_ns > 1e9 * MAX_LATENCY_S
        start_ns, chunks = (host_time_ns, 0) if stalled else (self._start_ns, self._chunks)
        prediction_us, ahead_us, late_us = self._window(host_time_ns, start_ns, chunks)
        # Of all readings that differ by whole wraps, the latest that is not beyond the window: nothing comes early.
        top_us = prediction_us + ahead_us
        unwrapped = top_us - (top_us - ticks) % DEVICE_CLOCK_MODULUS_US
        # It may be late, but neither by more than a link can keep, nor far before what came already.
        newest_us = np.maximum.accumulate(np.maximum(unwrapped, self.newest_us))
        earliest_us = np.maximum(newest_us - int(1e6 * MAX_REORDER_S), prediction_us - late_us)
        explained = unwrapped >= earliest_us
        n = len(ticks) if explained.all() else int(np.argmin(explained))
        if not n:
            return ticks[:0]
        self.newest_us = int(newest_us[n - 1])
        delay_us = 1e-3 * host_time_ns - self.newest_us
        skew_us = MAX_SKEW_PPM * 1e-9 * max(0, host_time_ns - self._reference_ns)
        # The least delay predicts best, but it ages as the clocks drift apart: a chunk nearly as fast renews it.
        if delay_us <= self._delay_us + skew_us:
            self._delay_us, self._reference_ns = delay_us, host_time_ns
        self._start_ns, self._chunks = start_ns, chunks + 1
        self._last_ns = max(self._last_ns, host_time_ns)
        return unwrapped[:n]

    def jump(self, device_time_us: int, host_time_ns: int) -> tuple[int, int]:
        """Measure a reading (as of :meth:`locate`) that nothing explains, without taking it into account.

        Returns
        -------
        disagreement_us : int
            The reading minus the prediction, modulo the wrap, in [-2**31, 2**31) us.
        gap_ns : int
            Host time since the previous chunk, ns.
        """
        prediction_us = int(1e-3 * host_time_ns - self._delay_us)
        half = DEVICE_CLOCK_MODULUS_US // 2
        away_us = (device_time_us - prediction_us + half) % DEVICE_CLOCK_MODULUS_US - half
        return away_us, host_time_ns - self._last_ns

    def unwrap_many(self, device_time_us: npt.NDArray[np.uint32], host_time_ns: IntArray) -> IntArray | None:
        """Unwrap the samples of many chunks at once, as :meth:`unwrap` would chunk by chunk.

        Only where that is plain: the clock runs on, and nothing comes near the bounds.

        Parameters
        ----------
        device_time_us : (n,) uint32
            Device clock of the samples in order of reception, n >= 1.
        host_time_ns : (n,) int64
            Reception of each sample's chunk.

        Returns
        -------
        (n,) int64 or None
            Unwrapped device time, us; None, and nothing is taken into account, where a chunk may hold a jump or
            starts a segment.
        """
        waits_ns = changes(host_time_ns, self._last_ns)
        if self.newest_us is None or waits_ns.min() < 0 or waits_ns.max() > 1e9 * MAX_LATENCY_S:
            return None
        ticks = device_time_us.astype(np.int64)
        half = DEVICE_CLOCK_MODULUS_US // 2
        unwrapped = changes(ticks, self.newest_us)
        np.add(unwrapped, half, out=unwrapped)
        np.bitwise_and(unwrapped, DEVICE_CLOCK_MODULUS_US - 1, out=unwrapped)  # the modulus is a power of two
        np.subtract(unwrapped, half, out=unwrapped)
        unwrapped[0] += self.newest_us
        np.cumsum(unwrapped, out=unwrapped)
        forward = unwrapped[0] >= self.newest_us and bool((unwrapped[1:] >= unwrapped[:-1]).all())
        newest_us = unwrapped if forward else np.maximum(np.maximum.accumulate(unwrapped), self.newest_us)
        # The prediction is off by no more than the delays differ. Half of what is explained leaves room for rounding.
        delay_us = 1e-3 * host_time_ns - unwrapped
        spread_us = max(float(delay_us.max()), self._delay_us) - min(float(delay_us.min()), self._delay_us)
        if spread_us > 0.5e6 * min(MAX_AHEAD_S, MAX_LATENCY_S) or (
            not forward and (newest_us - unwrapped).max() > 0.5e6 * MAX_REORDER_S
        ):
            return None
        lasts = np.append(np.flatnonzero(waits_ns[1:]), len(ticks) - 1)  # of each chunk
        host_ns = host_time_ns[lasts]
        delay_us = 1e-3 * host_ns - newest_us[lasts]
        # A chunk becomes the reference where none before is below it by more than the skew allows: the least of these.
        level_us = delay_us - MAX_SKEW_PPM * 1e-9 * (host_ns - self._reference_ns)
        best = len(level_us) - 1 - int(np.argmin(level_us[::-1]))
        if level_us[best] <= self._delay_us:
            self._delay_us, self._reference_ns = float(delay_us[best]), int(host_ns[best])
        self.newest_us = int(newest_us[-1])
        self._last_ns = int(host_ns[-1])
        self._chunks += len(lasts)
        return unwrapped

    def locate(self, device_time_us: int, host_time_ns: int) -> int | None:
        """Unwrap one reading (EVENT, STATUS, TIME_REPLY), us, without taking it into account.

        Of a u64 uptime the low 32 bits are used. None if no sample of the present segment has come, or if the reading
        does not belong to it; ``host_time_ns`` is its reception, monotonic.
        """
        if self.newest_us is None:
            return None
        prediction_us, ahead_us, late_us = self._window(host_time_ns, self._start_ns, self._chunks)
        top_us = prediction_us + ahead_us
        unwrapped_us = top_us - (top_us - device_time_us) % DEVICE_CLOCK_MODULUS_US
        return unwrapped_us if unwrapped_us >= prediction_us - late_us else None

    def is_plain(self, device_time_us: int, host_time_ns: int) -> bool:
        """Return whether :meth:`locate` places a reading now, and still does after any :meth:`unwrap_many`."""
        away_us, _ = self.jump(device_time_us, host_time_ns)
        # What unwrap_many unwraps moves the prediction by no more than half of what is explained.
        return self.newest_us is not None and abs(away_us) <= 0.25e6 * min(MAX_AHEAD_S, MAX_LATENCY_S)

    def _window(self, host_time_ns: int, start_ns: int, chunks: int) -> tuple[int, int, int]:
        """Return the prediction, and how far ahead of it and behind it a reading is explained, all us."""
        skew_us = MAX_SKEW_PPM * 1e-9 * max(0, host_time_ns - self._reference_ns)
        late_us = int(1e6 * MAX_LATENCY_S + skew_us)
        settled = chunks >= SETTLE_CHUNKS and host_time_ns - start_ns >= 1e9 * SETTLE_S
        ahead_us = int(1e6 * MAX_AHEAD_S + skew_us) if settled else late_us
        return int(1e-3 * host_time_ns - self._delay_us), ahead_us, late_us
