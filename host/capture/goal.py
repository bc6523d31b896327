"""When a capture has what it was started for."""

from __future__ import annotations

from host.capture.guide import Guide
from host.capture.settings import CaptureSettings
from host.trial.live import Trial

LINGER_PERIODS, MAX_LINGER_S = 0.35, 10.0
"""How long to go on after the last cycle: the offline search wants to see the way back from its end point."""


class Goal:
    """Watches a trial until it has as many cycles, as narrow an interval, or as long a time as asked for."""

    def __init__(self, settings: CaptureSettings, trial: Trial, guide: Guide | None) -> None:
        self._settings = settings
        self._trial = trial
        self._guide = guide
        self._counted_ns: int | None = None  # when the last cycle was counted

    @property
    def enough(self) -> bool:
        """Whether there are as many cycles, or as narrow an interval, as asked for."""
        settings, interval = self._settings, self._trial.score.interval
        half_width_deg, cycles = settings.until_half_width_deg, settings.cycles
        if half_width_deg is not None and interval is not None and interval.half_width_deg <= half_width_deg:
            return True
        if cycles is None and half_width_deg is None and settings.guide is not None:
            cycles = settings.guide.cycles
        return cycles is not None and self._trial.n_endpoints > cycles

    def reached(self, now_ns: int, elapsed_s: float) -> str:
        """Return in words why the capture ends now, so long after the first sample; nothing while it goes on."""
        settings = self._settings
        if self._guide is not None:
            if self._guide.done:
                return "the guided trial is complete"
        elif settings.until_half_width_deg is not None and self.enough:
            return f"the interval is within ±{settings.until_half_width_deg:g}°"
        elif settings.cycles is not None and (counted := self._counted(settings.cycles, now_ns)):
            return counted
        if settings.duration_s is not None and elapsed_s >= settings.duration_s:
            return f"{settings.duration_s:g} s are over"
        return ""

    def _counted(self, cycles: int, now_ns: int) -> str:
        trial = self._trial
        if trial.n_endpoints > cycles:
            self._counted_ns = self._counted_ns or now_ns
            linger_s = min(MAX_LINGER_S, LINGER_PERIODS * (trial.period_s or 1.0))
            return f"{cycles} cycles are done" if now_ns - self._counted_ns >= linger_s * 1e9 else ""
        # The last end point of a motion of just so many cycles closes one less: then the pause after it decides.
        return "the hand rests" if trial.n_endpoints == cycles and trial.paused else ""
