"""The lower envelope of delays: the line below all of them and as close to them as a line can be.

Delay is host arrival minus device time. It is offset, plus skew, plus what transport added, and transport only adds.
The best line below n points (least sum of distances) is the edge of their lower convex hull above their mean abscissa:
S. B. Moon, P. Skelly, D. Towsley, "Estimation and removal of clock skew from network delay measurements", INFOCOM
1999.

Why the lower edge and not a regression: a busy laptop adds tens of milliseconds to most arrivals of a minute, and never
takes a microsecond away from one. A mean moves with the load; the fastest arrivals do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Point = tuple[int, int]
"""Device time in us (not wrapped), delay in ns."""


@dataclass(frozen=True, slots=True)
class DelayLine:
    """Delay as a line over device time."""

    at_us: int
    """Device time of the anchor, us."""
    delay_ns: float
    """Host minus device time at the anchor, ns."""
    slope: float
    """Delay gained in device time, ns per us (1e-3 ppm)."""

    def delay_at(self, device_us: int) -> float:
        """Return the delay in ns at ``device_us``."""
        return self.delay_ns + self.slope * (device_us - self.at_us)

    def lowered(self, by_ns: float) -> DelayLine:
        """Return the same line ``by_ns`` lower."""
        return DelayLine(self.at_us, self.delay_ns - by_ns, self.slope)

    def to_host_ns(self, device_us: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return the host time of device times, ns.

        Parameters
        ----------
        device_us : (...,) int64
            Device time, not wrapped, us.
        """
        device_us = np.asarray(device_us, dtype=np.int64)
        gained_ns = np.rint(self.slope * (device_us - self.at_us)).astype(np.int64)
        return 1000 * device_us + (gained_ns + round(self.delay_ns))  # apart: a float cannot hold days in ns


def lower_hull(points: Sequence[Point]) -> list[Point]:
    """Return the lower convex hull, left to right, by Andrew's monotone chain; O(n), exact in integers.

    Parameters
    ----------
    points : sequence of Point
        In order of device time; where two have the same time, the lower one counts.
    """
    hull: list[Point] = []
    for point in points:
        x, y = point
        if hull and hull[-1][0] == x:
            if hull[-1][1] <= y:
                continue
            hull.pop()
        # The last corner stays only if the hull turns left there: on or above the chord it is no part of the edge.
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2], hull[-1]
            if (y1 - y0) * (x - x0) < (y - y0) * (x1 - x0):
                break
            hull.pop()
        hull.append(point)
    return hull


def hull_line(points: Sequence[Point], at_us: int) -> DelayLine:
    """Return the hull's edge above ``at_us`` as a line, anchored there; outside the points the nearest edge.

    Parameters
    ----------
    points : sequence of Point
        At least one, in order of device time. Of a single one the line is level.

    Raises
    ------
    ValueError
        No points.
    """
    hull = lower_hull(points)
    if not hull:
        raise ValueError("an envelope needs at least one point")
    if len(hull) == 1:
        return DelayLine(at_us, float(hull[0][1]), 0.0)
    right = 1
    while right < len(hull) - 1 and hull[right][0] < at_us:
        right += 1
    (x0, y0), (x1, y1) = hull[right - 1], hull[right]
    slope = (y1 - y0) / (x1 - x0)
    return DelayLine(at_us, y0 + slope * (at_us - x0), slope)


def envelope_line(points: Sequence[Point]) -> DelayLine:
    """Return the line below all ``points`` with the least sum of distances (hull edge above their mean time)."""
    if not points:
        raise ValueError("an envelope needs at least one point")
    # The sum of distances is n times the height of the points' mean above the line. So the best line below all points
    # is the one highest at the mean time: the hull's edge there.
    return hull_line(points, sum(x for x, _ in points) // len(points))


def line_with_slope(points: Sequence[Point], slope: float) -> DelayLine:
    """Return the highest line of the given slope (ns per us) that is below all ``points``, anchored at the last."""
    if not points:
        raise ValueError("an envelope needs at least one point")
    at_us = points[-1][0]
    return DelayLine(at_us, min(y - slope * (x - at_us) for x, y in points), slope)


def scatter_ns(points: Sequence[Point], line: DelayLine) -> float:
    """Return the 90th percentile of the points' distance above the line, ns."""
    residuals = sorted(y - line.delay_at(x) for x, y in points)
    return residuals[(9 * (len(residuals) - 1) + 9) // 10]
