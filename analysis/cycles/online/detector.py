"""Where each cycle ends, while the hand still turns: causal, constant work per sample, bounded memory.

What it finds is provisional, for the live view: the offline search (:mod:`analysis.cycles.search`) at the end of a
trial gives the result. An extreme is confirmed when the angle about the motion axis has gone back far enough; then its
dwell is looked up in a ring of recent moments and its middle is the end point. The first turning point is the start
pose, never an end point. Odd cycles are flagged, never dropped.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from statistics import median

import numpy as np
import numpy.typing as npt

from analysis.cycles.endpoints import pose_jumps
from analysis.cycles.online.angle import BIN_S, AnglePoint, OnlineAngle
from analysis.cycles.online.dwell import place_endpoint
from analysis.cycles.online.filters import HumpFilter, OutlierFilter, TimedSample
from analysis.cycles.online.state import OnlineState
from analysis.cycles.settings import CycleSettings, Endpoint

__all__ = ["OnlineCycleDetector", "OnlineState"]

_RING = 4096  # moments remembered: 10 periods, or 40 s before the period is known
_KEPT = 12  # end points remembered for the live view
_MIN_RETREAT_RAD = math.radians(1.0)
_NOISE_RETREAT = 8.0
_FIRST_RETREAT = 0.25  # of the way to the first extreme: beyond its dwell
_MAX_WRIGGLE = 6  # so many extremes at the beginning may be movement before the first cycle
_NOISE_TRAVEL = 12.0  # of the first extreme: hours of rest before a trial must not make one
_MAX_GAP_PERIODS = 0.25
_MAX_GAP_S = 0.5  # before the period is known
_PATIENCE_S = 10.0  # before the period is known
_POINTS_PER_PERIOD = 400


class OnlineCycleDetector:
    """Find end points sample by sample.

    Parameters
    ----------
    settings
        The offline settings; depth of the dwell, regular spacing and swing are taken from it.
    """

    def __init__(self, settings: CycleSettings | None = None) -> None:
        self._settings = settings or CycleSettings()
        self._angle = OnlineAngle()
        self._ring: deque[AnglePoint] = deque(maxlen=_RING)
        self._outliers = OutlierFilter()
        self._bin: list[TimedSample] = []
        self._last_s = -math.inf
        self._samples = 0
        self._swings: deque[float] = deque(maxlen=6)
        self._spacings: deque[float] = deque(maxlen=6)
        self._recent: tuple[deque[Endpoint], deque[Endpoint]] = (deque(maxlen=_KEPT), deque(maxlen=_KEPT))
        self._counts = [0, 0]  # lower, upper
        self._primary: int | None = None
        self._runs = 0
        self._top_speed = 0.0
        self._gap_flag = False
        self._first_rad: float | None = None
        self._rising: bool | None = None
        self._high = self._low = self._turn = AnglePoint(0.0, 0.0, (1.0, 0.0, 0.0, 0.0), 0)
        self._humps = (HumpFilter(-1.0), HumpFilter(1.0))
        self._previous_s: list[float | None] = [None, None]
        self._withdrawn = 0

    @property
    def period_s(self) -> float:
        """Median of the recent distances between end points, s; 0 where unknown."""
        return median(self._spacings) if self._spacings else 0.0

    def feed(
        self,
        times_s: npt.ArrayLike,
        quats_wxyz: npt.ArrayLike,
        index: Iterable[int] | None = None,
    ) -> list[Endpoint]:
        """Take samples in time order and give the primary end points they confirm.

        Parameters
        ----------
        times_s
            (n,) s. A sample that is not later than the one before, or not a number, is passed over.
        quats_wxyz
            (n, 4) unit, scalar first, body to world.
        index
            (n,) how the samples are named; default: counted from 0.

        Returns
        -------
        Newly confirmed end points of the primary extreme (the one reached first), oldest first.
        """
        times = np.asarray(times_s, dtype=np.float64).tolist()
        quats = np.asarray(quats_wxyz, dtype=np.float64).reshape(-1, 4).tolist()
        names = range(self._samples, self._samples + len(times)) if index is None else index
        confirmed: list[Endpoint] = []
        for time_s, (w, x, y, z), name in zip(times, quats, names, strict=True):
            self._samples += 1
            if not math.isfinite(time_s + w + x + y + z) or time_s <= self._last_s:
                continue
            self._last_s = time_s
            for sample in self._outliers.add((time_s, (w, x, y, z), int(name))):
                if self._bin and sample[0] - self._bin[0][0] < self._bin_s() * 0.999:
                    self._bin.append(sample)
                    continue
                if self._bin:
                    withdrawn = self._withdrawn
                    new = self._close_bin()
                    confirmed = new if self._withdrawn > withdrawn else confirmed + new
                self._bin = [sample]
        return confirmed

    def finish(self) -> list[Endpoint]:
        """Use the samples still held back; for the end of a recording."""
        self._bin += self._outliers.flush()
        confirmed = self._close_bin() if self._bin else []
        self._bin = []
        return confirmed

    @property
    def state(self) -> OnlineState:
        """A snapshot that later samples do not change."""
        now = self._ring[-1] if self._ring else None
        if now is None:
            return OnlineState()
        primary = 1 if self._primary is None else self._primary
        recent = tuple(self._recent[primary])
        period_s = self.period_s
        since = now.time_s - recent[-1].time_s if recent else 0.0
        swing_rad = median(self._swings) if self._swings else 0.0
        flags = []
        if self._gap_flag:
            flags.append("gap")
        if self._angle.axis_share < self._settings.min_axis_share:
            flags.append("axis ambiguous")
        if self._swings and self._angle.noise_rad > self._settings.max_noise * swing_rad:
            flags.append("noisy")
        if period_s and since > self._settings.pause * period_s:
            flags.append("pause")
        return OnlineState(
            time_s=now.time_s,
            moving=self._angle.speed > self._settings.moving_share * self._top_speed > 0.0,
            period_s=period_s or float("nan"),
            axis=self._angle.axis,
            axis_share=self._angle.axis_share,
            angle_deg=math.degrees(now.angle_rad),
            swing_deg=math.degrees(swing_rad),
            phase=min(since / period_s, 1.0) if period_s else 0.0,
            endpoints=self._counts[primary],
            other_endpoints=self._counts[1 - primary],
            recent=recent,
            withdrawn=self._withdrawn,
            runs=self._runs,
            flags=tuple(flags),
        )

    def _bin_s(self) -> float:
        return max(BIN_S, self.period_s / _POINTS_PER_PERIOD)

    def _close_bin(self) -> list[Endpoint]:
        """Average the samples of one bin and look whether an extreme is confirmed."""
        last = self._ring[-1] if self._ring else None
        if len(self._bin) == 1:
            time_s, quat, name = self._bin[0]
        else:
            w0, x0, y0, z0 = self._bin[0][1]
            w = x = y = z = total_s = 0.0
            for at_s, (a, b, c, d), _ in self._bin:
                sign = -1.0 if a * w0 + b * x0 + c * y0 + d * z0 < 0.0 else 1.0
                w, x, y, z, total_s = w + sign * a, x + sign * b, y + sign * c, z + sign * d, total_s + at_s
            length = math.sqrt(w * w + x * x + y * y + z * z)
            quat = (w / length, x / length, y / length, z / length)
            time_s, name = total_s / len(self._bin), self._bin[len(self._bin) // 2][2]
        period_s = self.period_s
        point = self._angle.add(time_s, quat, name, period_s)
        self._top_speed = max(self._top_speed * (1.0 - 1e-4), self._angle.speed)
        if last is None or time_s - last.time_s > max(_MAX_GAP_PERIODS * period_s or _MAX_GAP_S, 3.0 * BIN_S):
            self._gap_flag = last is not None
            self._start_run(point)
        self._ring.append(point)
        return self._follow(point)

    def _start_run(self, point: AnglePoint) -> None:
        self._runs += 1
        self._ring.clear()
        self._rising = None
        self._high = self._low = self._turn = point
        self._previous_s = [None, None]

    def _retreat_rad(self, extreme: AnglePoint, now_s: float) -> float:
        """How far the angle must go back before an extreme counts.

        A large first movement, that of putting the object in place, must not hide the smaller cycles after it: it
        ends as soon as its dwell is over. Where nothing turned for long, less is asked for, down to a third.
        """
        travel = abs(extreme.angle_rad - self._turn.angle_rad)
        if self._first_rad is None:
            return max(_MIN_RETREAT_RAD, _NOISE_RETREAT * self._angle.noise_rad, _FIRST_RETREAT * travel)
        usual = median(self._swings) if self._swings else travel
        patience_s = max(1.5 * self.period_s, 0.0 if self._spacings else _PATIENCE_S)
        late = (now_s - extreme.time_s) / patience_s
        share = self._settings.hysteresis * (1.0 if late < 1.0 else max(0.5 ** (late - 1.0), 1.0 / 3.0))
        return max(_MIN_RETREAT_RAD, _NOISE_RETREAT * self._angle.noise_rad, share * usual)

    def _follow(self, now: AnglePoint) -> list[Endpoint]:
        if now.angle_rad > self._high.angle_rad:
            self._high = now
        if now.angle_rad < self._low.angle_rad:
            self._low = now
        if self._rising is not False and self._went_back(self._high, now):
            return self._turned(self._high, now, upper=1)
        if self._rising is not True and self._went_back(self._low, now):
            return self._turned(self._low, now, upper=0)
        return []

    def _went_back(self, extreme: AnglePoint, now: AnglePoint) -> bool:
        back = abs(extreme.angle_rad - now.angle_rad)
        return back >= _MIN_RETREAT_RAD and back >= self._retreat_rad(extreme, now.time_s)

    def _turned(self, extreme: AnglePoint, now: AnglePoint, *, upper: int) -> list[Endpoint]:
        """Make the extreme that the angle has gone back from an end point, unless it is the start pose."""
        start = self._turn
        travel = abs(extreme.angle_rad - start.angle_rad)
        self._rising = not upper
        self._turn = extreme
        self._high = self._low = now
        if self._first_rad is None and travel < max(_MIN_RETREAT_RAD, _NOISE_TRAVEL * self._angle.noise_rad):
            return []  # the start pose itself
        endpoint, put_in_place = place_endpoint(
            [point for point in self._ring if point.time_s >= start.time_s],
            extreme,
            usual_rad=median((*self._swings, travel)),
            period_s=self.period_s,
            settings=self._settings,
        )
        if self._first_rad is None and put_in_place:
            return []  # moved here, then held: this is the start pose
        before = (self._first_rad or 0.0, *self._swings)
        if len(before) < _MAX_WRIGGLE and 0.0 < max(before) < self._settings.hysteresis * travel:
            self._start_over()  # what came before was a wriggle before the first cycle
        if self._swings and not self._settings.swing[0] <= travel / median(self._swings) <= self._settings.swing[1]:
            endpoint = replace(endpoint, flags=(*endpoint.flags, "odd swing"))
        if self._first_rad is None:
            self._first_rad = travel  # no swing: the way to the first extreme begins anywhere
        else:
            self._swings.append(travel)
        self._gap_flag = False
        if self._primary is None:
            self._primary = upper
        passed, anew = self._humps[upper].add(endpoint, extreme.angle_rad, median(self._swings or [travel]))
        if anew:
            self._start_over(upper)
        passed = [self._learned(point, upper) for point in passed]
        return passed if upper == self._primary else []

    def _start_over(self, kind: int | None = None) -> None:
        """Take back all end points, or those of one extreme."""
        for upper in (0, 1) if kind is None else (kind,):
            if upper == self._primary:
                self._withdrawn += self._counts[upper]
            self._counts[upper] = 0
            self._recent[upper].clear()
            self._previous_s[upper] = None
        self._spacings.clear()
        if kind is None:
            self._primary = None
            self._swings.clear()
            self._humps = (HumpFilter(-1.0), HumpFilter(1.0))

    def _learned(self, endpoint: Endpoint, upper: int) -> Endpoint:
        """Count an end point, learn the period from it, and flag an odd distance from the one before."""
        settings, previous_s, period_s = self._settings, self._previous_s[upper], self.period_s
        self._previous_s[upper] = endpoint.time_s
        if previous_s is not None:
            spacing_s = endpoint.time_s - previous_s
            if period_s and not settings.spacing[0] <= spacing_s / period_s <= settings.spacing[1]:
                endpoint = replace(endpoint, flags=(*endpoint.flags, "odd spacing"))
            alike = self._humps[0].humps == self._humps[1].humps  # else one extreme still counts humps as cycles
            if (alike or upper == self._primary) and (not period_s or spacing_s <= settings.pause * period_s):
                self._spacings.append(spacing_s)
        self._counts[upper] += 1
        self._recent[upper].append(endpoint)
        if pose_jumps(np.array([point.quat_wxyz for point in self._recent[upper]]))[-1:].any():
            endpoint = replace(endpoint, flags=(*endpoint.flags, "pose jump"))
            self._recent[upper][-1] = endpoint
        return endpoint
