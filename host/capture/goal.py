"""When a capture has what it was started for."""

from __future__ import annotations

from host.capture.guide import Guide
from host.capture.settings import CaptureSettings
from host.trial.live import Trial

MAX_LINGER_S = 10.0


class Goal:
    """Watches a trial until it has as many cycles, as narrow an interval, or as long a time as asked for.

    Parameters
    ----------
    settings : CaptureSettings
        What was asked for.
    trial : Trial
        The trial.
    """

    def __init__(self, settings: CaptureSettings, trial: Trial) -> None:
        self.guide = None if settings.guide is None else Guide(settings.guide)
        """Leads through the trial, where one was asked for."""
        self._settings = settings
        self._trial = trial
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

    def reached(self, now_ns: int, lasted_ns: int | None) -> str | None:
        """Return in words why the capture ends now; None while it goes on.

        Parameters
        ----------
        now_ns : int
            Monotonic time.
        lasted_ns : int or None
            Since the first sample; None before it.
        """
        settings = self._settings
        if self.guide is not None:
            if self.guide.done:
                return "the guided trial is complete"
        elif settings.until_half_width_deg is not None and self.enough:
            return f"the interval is within ±{settings.until_half_width_deg:g}°"
        elif settings.cycles is not None and self._trial.n_endpoints >= settings.cycles:
            reason = self._counted(settings.cycles, now_ns)
            if reason is not None:
                return reason
        if lasted_ns is not None and settings.duration_s is not None and lasted_ns >= settings.duration_s * 1e9:
            return f"{settings.duration_s:g} s are over"
        return None

    def _counted(self, cycles: int, now_ns: int) -> str | None:
        if self._trial.n_endpoints == cycles:
            # The last end point of a motion of just so many cycles closes one less: then the pause after it decides.
            return "the hand rests" if self._trial.paused else None
        # The offline search wants to see the way back from the last end point.
        self._counted_ns = self._counted_ns or now_ns
        linger_s = min(MAX_LINGER_S, self._settings.linger_periods * (self._trial.period_s or 1.0))
        return f"{cycles} cycles are done" if now_ns - self._counted_ns >= linger_s * 1e9 else None
