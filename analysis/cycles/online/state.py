"""A snapshot of the online search, for the live view."""

from __future__ import annotations

from dataclasses import dataclass

from analysis.cycles.online.angle import Vector
from analysis.cycles.settings import Endpoint


@dataclass(frozen=True)
class OnlineState:
    """What is known at this moment; for the live view."""

    time_s: float = float("nan")
    """Of the newest sample, s."""
    moving: bool = False
    """Whether the object turns right now."""
    period_s: float = float("nan")
    """Median of the recent cycles, s; NaN before two end points."""
    axis: Vector = (0.0, 0.0, 1.0)
    """Unit motion axis, world frame."""
    axis_share: float = 1.0
    """Share of the recent motion about the axis."""
    angle_deg: float = 0.0
    """Angle about the axis since the start, deg."""
    swing_deg: float = 0.0
    """Median of the recent swings, deg."""
    phase: float = 0.0
    """0 at the last primary end point, 1 where the next is due; stays at 1 until it is confirmed."""
    endpoints: int = 0
    """Primary end points so far."""
    other_endpoints: int = 0
    """End points of the other extreme so far."""
    recent: tuple[Endpoint, ...] = ()
    """The last primary end points, at most 12, oldest first."""
    withdrawn: int = 0
    """End points taken back so far: they were movement before the first cycle. A caller that keeps a list of what
    ``feed`` returned drops all of it, but what the same call returned, when this number has grown."""
    runs: int = 0
    """Runs of samples without a gap in the data, so far."""
    flags: tuple[str, ...] = ()
    """``gap``, ``axis ambiguous``, ``noisy``, ``pause``: what to look at now."""
