"""What the end points found so far show of the cycles: swing, period, which extreme is scored, what is odd."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from statistics import median

import numpy as np

from analysis.cycles.endpoints import pose_jumps
from analysis.cycles.online.peaks import PeakFilter
from analysis.cycles.settings import CycleSettings, Endpoint

_KEPT = 12  # end points remembered for the live view
_USUAL_OF = 6  # the usual swing and distance are medians of so many
_TREMOR_RAD = math.radians(1.5)
_MAX_EARLY = 6  # so many extremes at the start may be movement before the first cycle


class ExtremeKind:
    """The end points of one kind of extreme, lower (sign −1) or upper (sign 1)."""

    def __init__(self, sign: float) -> None:
        self.peaks = PeakFilter(sign)
        self.count = 0
        self.recent: deque[Endpoint] = deque(maxlen=_KEPT)
        self.previous_s: float | None = None
        """Time of the last end point, s; None where a gap or a fresh start lies between."""

    def clear(self) -> None:
        """Forget the end points; the pattern of peaks stays."""
        self.count = 0
        self.recent.clear()
        self.previous_s = None


class KnownCycles:
    """Collect the extremes that may be end points, and learn from them.

    Parameters
    ----------
    settings : CycleSettings
        Regular spacing and swing are taken from it.
    """

    def __init__(self, settings: CycleSettings) -> None:
        self.primary: int | None = None
        """The kind of extreme that was reached first and is scored: 0 lower, 1 upper; None before one was."""
        self.kinds = (ExtremeKind(-1.0), ExtremeKind(1.0))
        self.withdrawn = 0
        """Primary end points taken back so far."""
        self.first_rad: float | None = None
        """Way to the first extreme, rad: no swing, as it starts anywhere; None before the first extreme."""
        self._settings = settings
        self._starts_anywhere = True  # the way to the next extreme starts anywhere, so it is not a swing
        self._swings_rad: deque[float] = deque(maxlen=_USUAL_OF)
        self._spacings_s: deque[float] = deque(maxlen=_USUAL_OF)

    @property
    def period_s(self) -> float:
        """Median of the recent distances between end points, s; 0 where unknown."""
        return median(self._spacings_s) if self._spacings_s else 0.0

    def swing_rad(self, default_rad: float = 0.0) -> float:
        """Return the median of the recent swings, rad; ``default_rad`` before the first."""
        return median(self._swings_rad) if self._swings_rad else default_rad

    def swing_with_rad(self, travel_rad: float) -> float:
        """Return the median of the recent swings and one more, rad."""
        return median((*self._swings_rad, travel_rad))

    def cut(self) -> None:
        """Note a gap in the data: neither the next distance between end points nor the way to them is of a cycle."""
        self._starts_anywhere = True
        for kind in self.kinds:
            kind.previous_s = None

    def add(self, endpoint: Endpoint, angle_rad: float, travel_rad: float, upper: int) -> list[Endpoint]:
        """Receive the next extreme, of kind ``upper``, with its angle and the way to it from the one before, rad.

        Returns
        -------
        The end points that follow from it if it is of the primary kind. Where :attr:`withdrawn` has grown, those
        returned before are void.
        """
        settings = self._settings
        before = (self.first_rad or 0.0, *self._swings_rad)
        # Neither the first few extremes nor any number of a tremor need be of a cycle: it is faster than any, or hardly
        # large enough to be seen as turning.
        tremor = 0.0 < self.period_s < settings.min_period_s or max(before) < _TREMOR_RAD
        early = len(before) < _MAX_EARLY or tremor
        if early and 0.0 < max(before) < settings.hysteresis * travel_rad:
            self._start_over()  # what came before was movement before the first cycle
        if self._swings_rad and not settings.swing[0] <= travel_rad / self.swing_rad() <= settings.swing[1]:
            endpoint = replace(endpoint, flags=(*endpoint.flags, "odd swing"))
        if self.first_rad is None:
            self.first_rad = travel_rad
        elif not self._starts_anywhere:
            self._swings_rad.append(travel_rad)
        self._starts_anywhere = False
        if self.primary is None:
            self.primary = upper
        kind = self.kinds[upper]
        passed, restarted = kind.peaks.add(endpoint, angle_rad, self.swing_rad(travel_rad))
        if restarted:  # until now each of several peaks counted as a cycle
            self._clear(upper)
        passed = [self._learned(point, upper) for point in passed]
        return passed if upper == self.primary else []

    def _start_over(self) -> None:
        """Take back all end points and whatever was learned from them."""
        for upper in range(len(self.kinds)):
            self._clear(upper)
        self.primary = None
        self._swings_rad.clear()
        self.kinds = (ExtremeKind(-1.0), ExtremeKind(1.0))

    def _clear(self, upper: int) -> None:
        """Take back the end points of one kind, and the period."""
        if upper == self.primary:
            self.withdrawn += self.kinds[upper].count
        self.kinds[upper].clear()
        self._spacings_s.clear()

    def _learned(self, endpoint: Endpoint, upper: int) -> Endpoint:
        """Count an end point, learn the period from it, and flag an odd distance from the one before."""
        settings, kind, period_s = self._settings, self.kinds[upper], self.period_s
        previous_s, kind.previous_s = kind.previous_s, endpoint.time_s
        if previous_s is not None:
            spacing_s = endpoint.time_s - previous_s
            if period_s and not settings.spacing[0] <= spacing_s / period_s <= settings.spacing[1]:
                endpoint = replace(endpoint, flags=(*endpoint.flags, "odd spacing"))
            # Where the kinds differ in peaks per cycle, one of them still counts peaks as cycles: then only the
            # primary one shows how long a cycle is. A pause does not.
            same = self.kinds[0].peaks.per_cycle == self.kinds[1].peaks.per_cycle
            if (same or upper == self.primary) and (not period_s or spacing_s <= settings.pause * period_s):
                self._spacings_s.append(spacing_s)
        kind.count += 1
        kind.recent.append(endpoint)
        if pose_jumps(np.array([point.quat_wxyz for point in kind.recent]))[-1:].any():
            endpoint = replace(endpoint, flags=(*endpoint.flags, "pose jump"))
            kind.recent[-1] = endpoint
        return endpoint
