"""Motion, sensor, link, clock, losses and recording: one line each.

Where a line has no room for all its parts, the least important are left out rather than cut.
"""

from __future__ import annotations

from host.screen.dashboard.boxes import Lines, end_of, framed
from host.screen.dashboard.score_panel import SILENCE_S
from host.screen.dashboard.theme import Look, Part
from host.trial.state import TrialState

HEIGHT = 8
RATE_TOLERANCE = 0.05
"""Relative difference from the expected rate that is marked."""
LOSS_LIMIT = 0.01
"""Share of missing samples that is marked as bad."""
NAME_WIDTH = 10


def status_panel(state: TrialState, look: Look, width: int) -> Lines:
    """Draw the panel; its height is :data:`HEIGHT`."""
    room = max(10, width - 4 - NAME_WIDTH)
    rows = (
        ("motion", _motion(state, look)),
        ("sensor", _sensor(state)),
        ("link", _link(state, room, look)),
        ("clock", _clock(state)),
        ("losses", _losses(state)),
        ("recording", _recording(state, room, look)),
    )
    lines = [look.join((f"{name:{NAME_WIDTH}}", "quiet")).append_text(look.listed(parts, room)) for name, parts in rows]
    return framed(lines, "", width, HEIGHT, look)


def phase_bar(share: float, look: Look, width: int = 6) -> str:
    """Draw how much of a cycle is done, 0-1, in a few cells."""
    done = min(width, max(0, int(share * width)))
    full, empty = ("=", ".") if look.ascii_only else ("▪", "·")
    return full * done + empty * (width - done)


def _motion(state: TrialState, look: Look) -> list[Part]:
    motion = state.motion
    of_period = "" if motion.period_s is None else f" of {_short(motion.period_s)} s"
    if motion.cycle_phase is not None:
        parts: list[Part] = [f"{motion.phase} {phase_bar(motion.cycle_phase, look)}{of_period}"]
    else:
        parts = [motion.phase, of_period and f"period{of_period.removeprefix(' of')}"]
    # At rest it turns about no axis at all, and that is as it should be.
    flags = [flag for flag in motion.flags if not (motion.at_rest and flag == "axis ambiguous")]
    if flags:
        parts.append((", ".join(flags), "doubtful"))
    if motion.swing_deg is not None:
        parts.append(f"swing {_short(motion.swing_deg, 1)}°")
    if state.sensor.orientation_wxyz is not None:
        parts.append((f"q {look.vector(state.sensor.orientation_wxyz, 2)}", "quiet"))
    return parts


def _sensor(state: TrialState) -> list[Part]:
    sensor = state.sensor
    if sensor.still is None:
        return ["no data yet"]
    parts: list[Part] = ["still" if sensor.still else "moving"]
    if sensor.saturated:
        parts.append(("SATURATED", "bad"))
    if sensor.temperature_c is not None:
        parts.append(f"{sensor.temperature_c:.0f} °C")
    if sensor.battery_v is not None:
        parts.append(f"{sensor.battery_v:.1f} V")
    if sensor.heading_deg_per_min is not None:
        if sensor.floor_deg is not None:
            parts.append(f"floor {sensor.floor_deg:.2g}°/cycle")
        parts.append(f"drifts {sensor.heading_deg_per_min:.2g}°/min")
    else:
        parts.append(("no baseline", "quiet"))
    if sensor.calibrated is False:
        parts.append(("uncalibrated", "doubtful"))
    return parts


def _link(state: TrialState, room: int, look: Look) -> list[Part]:
    link = state.link
    rate = "- Hz" if link.rate_hz is None else f"{link.rate_hz:.1f} Hz"
    expected = "" if link.expected_rate_hz is None else f" of {link.expected_rate_hz:.0f}"
    off = (
        link.rate_hz is not None
        and link.expected_rate_hz is not None
        and abs(link.rate_hz / link.expected_rate_hz - 1) > RATE_TOLERANCE
    )
    parts: list[Part] = [(f"{rate}{expected}", "doubtful" if off else "plain")]
    if not link.connected:
        parts.append(("DISCONNECTED", "bad"))
    elif link.silent_s > SILENCE_S:
        parts.append((f"silent for {link.silent_s:.0f} s", "bad"))
    if link.overflow_chunks:
        parts.append((f"{link.overflow_chunks} chunks not taken in time", "bad"))
    parts.append((_counted(link.reconnects, "reconnect"), "doubtful" if link.reconnects else "quiet"))
    if link.segments > 1:
        n = link.segments - 1
        parts.append((link.segment_reason if n == 1 else _counted(n, "reset"), "doubtful"))
    if link.one_way:
        parts.append(("does not answer", "doubtful"))
    parts.append((end_of(link.name, max(12, room - len("1000.0 Hz of 1000 · 10 reconnects · ")), look), "quiet"))
    return parts


def _clock(state: TrialState) -> list[Part]:
    """Say how the object's clock runs against the host's, and how unevenly the link delivers."""
    link = state.link
    if link.jitter_p99_ms is None:
        return ["no data yet"]
    parts: list[Part] = [("warming up", "quiet") if link.skew_ppm is None else f"skew {link.skew_ppm:+.1f} ppm"]
    middle = "" if link.jitter_p50_ms is None else f"p50 {link.jitter_p50_ms:.2f}, "
    parts.append(f"jitter {middle}p99 {link.jitter_p99_ms:.2f} ms")
    if link.offset_interval_ns is None:
        parts.append(("offset unknown", "quiet"))
    else:
        low_ns, high_ns = link.offset_interval_ns
        parts.append(f"offset ±{0.5e-6 * abs(high_ns - low_ns):.2f} ms")
    if link.skew_ppm is not None and link.clock_warm_up_s is not None:
        parts.append((f"warm after {link.clock_warm_up_s:.0f} s", "quiet"))
    return parts


def _losses(state: TrialState) -> list[Part]:
    losses, link = state.link.losses, state.link
    if not losses.produced:
        return ["no data yet"]
    parts: list[Part] = []
    if losses.missing:
        parts.append(
            (
                f"{100 * losses.share:.2f} % missing: {losses.lost} lost, {losses.rejected} damaged, "
                f"{losses.dropped} dropped",
                "bad" if losses.share > LOSS_LIMIT else "doubtful",
            )
        )
    else:
        parts.append((f"none of {losses.produced} samples", "good"))
    if not link.name.startswith("can:"):  # a CAN controller checks frames by itself and tells nobody
        parts.append((_counted(link.crc_errors, "CRC error"), "doubtful" if link.crc_errors else "quiet"))
    if link.malformed:
        parts.append((f"{link.malformed} malformed", "doubtful"))
    return parts


def _recording(state: TrialState, room: int, look: Look) -> list[Part]:
    recording = state.recording
    if recording.problem:
        return [(recording.problem, "bad")]
    parts: list[Part] = [f"{recording.n_bytes / 1e6:.1f} MB"]
    used = len("9999.9 MB")
    if recording.free_bytes is not None:
        low = recording.free_bytes < 1e9
        free = f"{recording.free_bytes / 1e9:.1f} GB free"
        parts.append((free, "bad" if low else "plain"))
        used += 3 + len(free)
    parts.append((end_of(recording.path, max(12, room - used - 3), look), "quiet"))
    return parts


def _short(value: float, places: int = 2) -> str:
    """Write a number so that it keeps its width from 1 to 999."""
    whole = len(str(int(abs(value))))
    return f"{value:.{max(0, places + 1 - whole)}f}"


def _counted(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
