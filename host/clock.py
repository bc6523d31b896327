"""The device's clock on the host's time line."""

from __future__ import annotations

from host.clock_unwrap import ClockStep, ClockUnwrapper, UnwrapSettings

__all__ = ["ClockStep", "ClockUnwrapper", "UnwrapSettings"]
