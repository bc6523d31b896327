"""When a capture has what it was started for."""

from __future__ import annotations

from host.capture.guide import Guide
from host.capture.settings import CaptureSettings
from host.trial.guarded import Guarded
from host.trial.live import Trial

LINGER_PERIODS, MAX_LINGER_S = 0.35, 10.0
"""How long to go on after the last cycle: the offline search wants to see the way back from its end point."""


class Goal:
    """Watches a trial until it has as many cycles, as narrow an interval, or as long a time as asked for."""

    def __init__(self, settings: CaptureSettings, trial: Trial, guide: Guarded[Guide] | None) -> None:
        self._settings = settings
        self._trial = trial
        self._guide = guide
        self._counted_ns: int | None = None  # when the last cycle was counted

    @property
    def enough(self) -> bool:
        """Whether there are as many cycles, or as narrow an interval, as asked for."""
        settings, interval = self._settings, self._trial.score.subject.interval
        half_width_deg, cycles = settings.until_half_width_deg, self._cycles
        if half_width_deg is not None and interval is not None and interval.half_width_deg <= half_width_deg:
            return True
        return cycles is not None and self._trial.n_endpoints > cycles

    @property
    def _cycles(self) -> int | None:
        """How many cycles to wait for; a guide has a number where the capture has neither number nor interval."""
        settings = self._settings
        if settings.cycles is None and settings.until_half_width_deg is None and settings.guide is not None:
            return settings.guide.cycles
        return settings.cycles

    def reached(self, now_ns: int, elapsed_s: float) -> str:
        """Return in words why the capture ends now, so long after the first sample; nothing while it goes on."""
        settings = self._settings
        if self._guide is not None and self._guide.works:  # without it, a guided trial ends as others do
            if self._guide.ask(lambda guide: guide.done, False):
                return "the guided trial is complete"
        elif settings.until_half_width_deg is not None and self.enough:
            return f"the interval is within ±{settings.until_half_width_deg:g}°"
        elif (cycles := self._cycles) is not None and (counted := self._counted(cycles, now_ns)):
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
