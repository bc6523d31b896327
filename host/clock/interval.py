"""How far mapped time may be from the truth, from the round trips of a recording: the offset as an interval.

The lower envelope cannot see a constant delay of the link: a sample may have been taken earlier than the time it is
mapped to. A TIME_REQUEST left before it was received, and its reply arrived after it was sent; together with the
arrivals themselves that bounds the offset of the two clocks on both sides, everywhere in the recording.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]

MODULUS_US = 2**32
MAX_LATENCY_US = 60_000_000
"""A reply whose clock reading is further from what the samples around it predict belongs to another segment."""
_FEW_WINDOWS = 100_000  # cost nothing, however empty


@dataclass(frozen=True, slots=True)
class OffsetInterval:
    """Where the truth lies: live, of host minus device time; offline, of host time minus the time mapped to."""

    low_ns: float | None
    """It is not below this, ns; None without round trips."""
    high_ns: float
    """Nor above this, ns."""
    consistent: bool
    """Whether the bounds agree everywhere. If not, somebody stamps too early: the device, its reception of requests (by
    a stale clock reading), or the host, its arrivals (before the read that brought them)."""
    n_round_trips: int
    """Round trips that bound it."""

    @property
    def bounds_ns(self) -> tuple[float, float] | None:
        """Both bounds, ns; None without round trips."""
        return None if self.low_ns is None else (self.low_ns, self.high_ns)

    @property
    def width_ns(self) -> float | None:
        """How well the truth is known, ns; None where it is not bounded, or the bounds contradict each other."""
        return None if self.low_ns is None or not self.consistent else self.high_ns - self.low_ns


@dataclass(frozen=True, slots=True, eq=False)
class RoundTrips:
    """k answers to TIME_REQUEST, device time as it is on the wire."""

    sent_ns: IntArray
    """(k,) host time just before the request was written, ns, monotonic."""
    receive_us: IntArray
    """(k,) device clock when the request came, us."""
    transmit_us: IntArray
    """(k,) device clock when the reply left, us."""
    received_ns: IntArray
    """(k,) host time of the chunk that brought the reply, ns; in order."""

    def __len__(self) -> int:
        return len(self.sent_ns)

    def chosen(self, which: npt.NDArray[np.bool_]) -> RoundTrips:
        """Return some of them."""
        return RoundTrips(self.sent_ns[which], self.receive_us[which], self.transmit_us[which], self.received_ns[which])


NO_ROUND_TRIPS = RoundTrips(*(np.empty(0, np.int64) for _ in range(4)))


def unwrapped_round_trips(
    trips: RoundTrips, unwrapped_us: IntArray, arrival_ns: IntArray, segment: IntArray
) -> tuple[RoundTrips, IntArray]:
    """Put the device's readings on the unwrapped time of the samples around them.

    Parameters
    ----------
    trips : RoundTrips
        As recorded.
    unwrapped_us, arrival_ns, segment : (n,) int64
        Device time, arrival and clock segment of the samples, in order of arrival.

    Returns
    -------
    RoundTrips, (k,) int64
        Those that fit, and the clock segment of each.
    """
    if not len(trips) or not len(arrival_ns):
        return NO_ROUND_TRIPS, np.empty(0, np.int64)
    nearest = np.clip(np.searchsorted(arrival_ns, trips.received_ns, side="right") - 1, 0, None)
    expected_us = unwrapped_us[nearest] + (trips.received_ns - arrival_ns[nearest]) // 1000
    half = MODULUS_US // 2
    off_us = (trips.transmit_us - expected_us + half) % MODULUS_US - half
    transmit_us = expected_us + off_us
    turn_us = trips.transmit_us - trips.receive_us
    fits = (np.abs(off_us) < MAX_LATENCY_US) & (turn_us >= 0) & (turn_us < MAX_LATENCY_US)
    # One that contradicts itself is no bound; 500 ppm of the time the device took are forgiven.
    spare_ns = trips.received_ns - trips.sent_ns - 1000 * turn_us
    fits &= spare_ns >= -turn_us // 2
    located = RoundTrips(trips.sent_ns, transmit_us - turn_us, transmit_us, trips.received_ns)
    return located.chosen(fits), segment[nearest][fits]


def offset_interval(
    late_us: IntArray,
    late_ns: FloatArray,
    trips: RoundTrips,
    trips_mapped_ns: tuple[IntArray, IntArray],
    window_s: float,
    tolerance: float,
) -> OffsetInterval:
    """Bound true minus mapped time over one segment: the loosest of what holds in each window.

    Parameters
    ----------
    late_us : (n,) int64
        Device time of the chunks' newest samples, us, in order.
    late_ns : (n,)
        Their arrival minus mapped time, ns.
    trips : RoundTrips
        Of this segment, unwrapped.
    trips_mapped_ns : (k,) int64, (k,) int64
        What the two device readings of each are mapped to, ns.
    window_s : float
        Width of the windows.
    tolerance : float
        How fast mapped and true time may part, ns per us: a bound counts for less with its distance.
    """
    half_us = 0.5e6 * window_s
    first, last = int(late_us[0]), int(late_us[-1])
    x = np.concatenate([late_us, trips.transmit_us])
    centres = _centres(first, last, max(1, int(half_us)), np.concatenate([x, trips.receive_us]))
    receive_map, transmit_map = trips_mapped_ns
    lows = (trips.receive_us, (trips.sent_ns - receive_map).astype(float))
    highs = (x, np.concatenate([late_ns, (trips.received_ns - transmit_map).astype(float)]))
    low = _bounds(lows, centres, half_us, tolerance, -1.0)
    high = _bounds(highs, centres, half_us, tolerance, 1.0)
    known = np.isfinite(low)
    return OffsetInterval(
        low_ns=float(low[known].min()) if known.any() else None,
        high_ns=float(high[np.isfinite(high)].max()),
        consistent=bool((low[known] <= high[known]).all()),
        n_round_trips=len(trips),
    )


def _centres(first: int, last: int, step: int, points: IntArray) -> IntArray:
    """Return the middles of windows two steps wide, one every step; of a long time with few points only the near ones.

    A window without points bounds nothing, and a clock that was set in between makes billions of them.
    """
    if last <= first:  # one chunk, or a clock that ran back
        return np.array([first])
    n = (last - first) // step + 1
    if n <= 4 * len(points) + _FEW_WINDOWS:
        return np.arange(first, last + 1, step)
    near = (points - first) // step
    return first + step * np.unique(np.clip(np.concatenate([near + k for k in (-1, 0, 1, 2)]), 0, n - 1))


def _bounds(
    points: tuple[IntArray, FloatArray], centres: IntArray, half_us: float, tolerance: float, sign: float
) -> FloatArray:
    """Return the tightest bound at each centre from the points of its window; infinite where there is none."""
    order = np.argsort(points[0], kind="stable")
    x, y = points[0][order], points[1][order]
    starts, stops = np.searchsorted(x, centres - half_us), np.searchsorted(x, centres + half_us, side="right")
    out = np.full(len(centres), sign * np.inf)
    for k, (start, stop) in enumerate(zip(starts.tolist(), stops.tolist(), strict=True)):
        if stop > start:
            carried = sign * y[start:stop] + tolerance * np.abs(x[start:stop] - centres[k])
            out[k] = sign * carried.min()
    return out
