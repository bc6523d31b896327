"""Where each cycle ends, while the hand still turns: causal, constant work per sample, bounded memory.

What it finds is provisional, for the live view: the offline search (:mod:`analysis.cycles.search`) at the end of a
trial makes the result. An extreme is confirmed when the angle about the motion axis has gone back far enough; then its
dwell is looked up in a ring of recent moments and its middle is the end point. The first turning point is the start
pose, never an end point. Odd cycles are flagged, never dropped.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from analysis.cycles.online.angle import BIN_S, AnglePoint, OnlineAngle
from analysis.cycles.online.dwell import place_endpoint
from analysis.cycles.online.known import KnownCycles
from analysis.cycles.online.moments import Moments, TimedSample
from analysis.cycles.online.state import OnlineState
from analysis.cycles.online.turning import TurningFinder
from analysis.cycles.settings import CycleSettings, Endpoint

__all__ = ["OnlineCycleDetector", "OnlineState"]

_RING = 4096  # moments remembered: 10 periods, or 40 s before the period is known
_MIN_RETREAT_RAD = math.radians(1.0)
_NOISE_RETREAT = 8.0
_FIRST_RETREAT = 0.25  # of the way to the first extreme: beyond its dwell
_NOISE_TRAVEL = 12.0  # of the first extreme: hours of rest before a trial must not make one
_MAX_GAP_PERIODS = 0.25
_MAX_GAP_S = 0.5  # before the period is known
_PATIENCE_S = 10.0  # before the period is known
_POINTS_PER_PERIOD = 400


class OnlineCycleDetector:
    """Find end points sample by sample.

    Samples become moments (:mod:`.moments`), these an angle about the motion axis (:mod:`.angle`), whose turning points
    (:mod:`.turning`) are placed in the middle of their dwell (:mod:`.dwell`); what they show of swing and period
    (:mod:`.known`) decides how far back the angle must go next time.

    Parameters
    ----------
    settings : CycleSettings, optional
        The offline settings; depth of the dwell, regular spacing and swing are taken from it.
    """

    def __init__(self, settings: CycleSettings | None = None) -> None:
        self._settings = settings or CycleSettings()
        self._samples = 0
        self._moments = Moments()
        self._angle = OnlineAngle()
        self._ring: deque[AnglePoint] = deque(maxlen=_RING)
        self._turning = TurningFinder(AnglePoint(0.0, 0.0, (1.0, 0.0, 0.0, 0.0), 0))
        self._known = KnownCycles(self._settings)
        self._top_speed = 0.0
        self._runs = 0
        self._after_gap = False

    @property
    def period_s(self) -> float:
        """Median of the recent distances between end points, s; 0 where unknown."""
        return self._known.period_s

    def feed(
        self,
        times_s: npt.ArrayLike,
        quats_wxyz: npt.ArrayLike,
        index: Iterable[int] | None = None,
    ) -> list[Endpoint]:
        """Receive samples in time order and return the primary end points they confirm.

        Parameters
        ----------
        times_s : array_like
            (n,) s. A sample that is not later than the one before, or not a number, is passed over.
        quats_wxyz : array_like
            (n, 4) unit, scalar first, body to world.
        index : iterable of int, optional
            (n,) how the samples are named; default: counted from 0.

        Returns
        -------
        Newly confirmed end points of the primary extreme (the one reached first), oldest first.
        """
        times = np.asarray(times_s, dtype=np.float64).tolist()
        quats = np.asarray(quats_wxyz, dtype=np.float64).reshape(-1, 4).tolist()
        names = range(self._samples, self._samples + len(times)) if index is None else index
        self._samples += len(times)
        confirmed: list[Endpoint] = []
        samples = zip(times, quats, names, strict=True)
        for moment in self._moments.feed((at_s, (w, x, y, z), int(name)) for at_s, (w, x, y, z), name in samples):
            withdrawn = self._known.withdrawn
            new = self._process(moment)
            confirmed = new if self._known.withdrawn > withdrawn else confirmed + new
        return confirmed

    def finish(self) -> list[Endpoint]:
        """Use the samples still held back; for the end of a recording."""
        return [point for moment in self._moments.flush() for point in self._process(moment)]

    @property
    def state(self) -> OnlineState:
        """A snapshot that later samples do not change."""
        if not self._ring:
            return OnlineState()
        now, known, settings = self._ring[-1], self._known, self._settings
        primary = 1 if known.primary is None else known.primary
        recent = tuple(known.kinds[primary].recent)
        period_s, swing_rad = known.period_s, known.swing_rad()
        since_s = now.time_s - recent[-1].time_s if recent else 0.0
        flags = {
            "gap": self._after_gap,
            "axis ambiguous": self._angle.axis_share < settings.min_axis_share,
            "noisy": swing_rad > 0.0 and self._angle.noise_rad > settings.max_noise * swing_rad,
            "pause": period_s > 0.0 and since_s > settings.pause * period_s,
        }
        return OnlineState(
            time_s=now.time_s,
            moving=self._angle.speed > settings.moving_share * self._top_speed > 0.0,
            period_s=period_s or float("nan"),
            axis=self._angle.axis,
            axis_share=self._angle.axis_share,
            angle_deg=math.degrees(now.angle_rad),
            swing_deg=math.degrees(swing_rad),
            phase=min(since_s / period_s, 1.0) if period_s else 0.0,
            endpoints=known.kinds[primary].count,
            other_endpoints=known.kinds[1 - primary].count,
            recent=recent,
            withdrawn=known.withdrawn,
            runs=self._runs,
            flags=tuple(flag for flag, is_set in flags.items() if is_set),
        )

    def _process(self, moment: TimedSample) -> list[Endpoint]:
        """Follow the angle to the next moment and look whether an extreme is confirmed."""
        period_s = self._known.period_s
        point = self._angle.add(*moment, period_s)
        self._top_speed = max(self._top_speed * (1.0 - 1e-4), self._angle.speed)
        max_gap_s = max(_MAX_GAP_PERIODS * period_s or _MAX_GAP_S, 3.0 * BIN_S)
        if not self._ring or point.time_s - self._ring[-1].time_s > max_gap_s:
            self._after_gap = bool(self._ring)
            self._start_run(point)
        self._ring.append(point)
        start = self._turning.last
        upper = self._turning.add(point, self._went_back)
        return [] if upper is None else self._turned(start, self._turning.last, upper)

    def _start_run(self, point: AnglePoint) -> None:
        self._runs += 1
        self._ring.clear()
        self._turning = TurningFinder(point)
        self._known.cut()

    def _went_back(self, extreme: AnglePoint, now: AnglePoint) -> bool:
        back = abs(extreme.angle_rad - now.angle_rad)
        return back >= _MIN_RETREAT_RAD and back >= self._retreat_rad(extreme, now.time_s)

    def _retreat_rad(self, extreme: AnglePoint, now_s: float) -> float:
        """Return how far the angle must go back before an extreme counts, rad.

        A large first movement, that of putting the object in place, must not hide the smaller cycles after it: it
        ends as soon as its dwell is over. Where nothing turned for long, less is asked for, down to a third.
        """
        travel = abs(extreme.angle_rad - self._turning.last.angle_rad)
        if self._known.first_rad is None:
            share = _FIRST_RETREAT * travel
        else:
            period_s = self._known.period_s
            late = (now_s - extreme.time_s) / max(1.5 * period_s, 0.0 if period_s else _PATIENCE_S)
            share = self._settings.hysteresis * (1.0 if late < 1.0 else max(0.5 ** (late - 1.0), 1.0 / 3.0))
            share *= self._known.swing_rad(travel)
        return max(_MIN_RETREAT_RAD, _NOISE_RETREAT * self._angle.noise_rad, share)

    def _turned(self, start: AnglePoint, extreme: AnglePoint, upper: int) -> list[Endpoint]:
        """Make the extreme that the angle has gone to from the one before an end point, unless it is the start pose."""
        known = self._known
        travel = abs(extreme.angle_rad - start.angle_rad)
        if known.first_rad is None and travel < max(_MIN_RETREAT_RAD, _NOISE_TRAVEL * self._angle.noise_rad):
            return []  # the start pose itself
        endpoint, put_in_place = place_endpoint(
            [point for point in self._ring if point.time_s >= start.time_s],
            extreme,
            usual_rad=known.swing_with_rad(travel),
            period_s=known.period_s,
            settings=self._settings,
        )
        if known.first_rad is None and put_in_place:
            return []  # moved here, then held: this is the start pose
        self._after_gap = False
        confirmed = known.add(endpoint, extreme.angle_rad, travel, upper)
        self._moments.width_s = max(BIN_S, known.period_s / _POINTS_PER_PERIOD)
        return confirmed
