"""How a capture is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from host.capture.guide import GuideSettings
from host.stream.session import SessionSettings


@dataclass(frozen=True, slots=True)
class CaptureSettings:
    """When a capture ends, and how it talks."""

    cycles: int | None = None
    """End after so many cycles."""
    duration_s: float | None = None
    """End so long after the first sample."""
    session: SessionSettings = SessionSettings()
    silence_limit_s: float = 30.0
    """End when the object sent nothing for so long."""
    reconnect_s: float = 30.0
    """How long a lost link may take to come back; 0 ends the capture at once."""
    debug_link: Path | None = None
    """File for everything that crosses the link, in hexadecimal; see :mod:`host.links.link_log`."""
    until_half_width_deg: float | None = None
    """End when the confidence interval of θ̄ is so narrow: half its width, deg."""
    guide: GuideSettings | None = None
    """Lead through the trial step by step; None for no guide."""
    read_pause_s: float = 0.0
    """Rest of a live link's reading thread, for other links; see :class:`host.links.reader_thread.ReaderThread`."""
