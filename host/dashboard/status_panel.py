"""Motion, sensor, link, losses and recording: one line each."""

from __future__ import annotations

from host.dashboard.boxes import Lines, framed
from host.dashboard.look import Look
from host.trial_state import TrialState

HEIGHT = 7
RATE_TOLERANCE = 0.05
"""Relative difference from the expected rate that is marked."""
LOSS_LIMIT = 0.01
"""Share of missing samples that is marked as bad."""
SILENCE_S = 1.0

Part = str | tuple[str, str]


def status_panel(state: TrialState, look: Look, width: int) -> Lines:
    """Draw the panel; its height is :data:`HEIGHT`."""
    rows = (
        ("motion", _motion(state, look)),
        ("sensor", _sensor(state)),
        ("link", _link(state)),
        ("losses", _losses(state)),
        ("recording", _recording(state)),
    )
    lines = [look.join((f"{name:11}", "quiet")).append_text(look.listed(parts)) for name, parts in rows]
    return framed(lines, "", width, HEIGHT, look)


def phase_bar(share: float, look: Look, width: int = 8) -> str:
    """Draw how much of a cycle is done, 0-1, in a few cells."""
    done = min(width, max(0, int(share * width)))
    full, empty = ("=", ".") if look.ascii_only else ("▪", "·")
    return full * done + empty * (width - done)


def _motion(state: TrialState, look: Look) -> list[Part]:
    motion = state.motion
    parts: list[Part] = [motion.phase]
    if motion.cycle_phase is not None:
        parts.append(f"cycle {phase_bar(motion.cycle_phase, look)}")
    if motion.period_s is not None:
        parts.append(f"period {motion.period_s:.2f} s")
    if motion.swing_deg is not None:
        parts.append(f"swing {motion.swing_deg:.1f}°")
    if motion.flags:
        parts.append((", ".join(motion.flags), "doubtful"))
    if state.sensor.orientation_wxyz is not None:
        parts.append(("q " + " ".join(f"{part:+.2f}" for part in state.sensor.orientation_wxyz), "quiet"))
    return parts


def _sensor(state: TrialState) -> list[Part]:
    sensor = state.sensor
    parts: list[Part] = ["no data" if sensor.still is None else "still" if sensor.still else "moving"]
    if sensor.saturated:
        parts.append(("SATURATED", "bad"))
    if sensor.temperature_c is not None:
        parts.append(f"{sensor.temperature_c:.1f} °C")
    if sensor.battery_v is not None:
        parts.append(f"{sensor.battery_v:.2f} V")
    if sensor.heading_deg_per_min is not None:
        parts.append(f"drifts {sensor.heading_deg_per_min:.2g}°/min")
        if sensor.floor_deg is not None:
            parts.append(f"floor {sensor.floor_deg:.2g}° per cycle")
    elif sensor.still is not None:
        parts.append(("floor unknown: no baseline", "quiet"))
    if sensor.calibrated is False:
        parts.append(("not calibrated", "doubtful"))
    return parts


def _link(state: TrialState) -> list[Part]:
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
    if link.segments > 1:
        parts.append((_counted(link.segments - 1, "reset"), "doubtful"))
    if link.reconnects:
        parts.append((_counted(link.reconnects, "reconnect"), "doubtful"))
    if link.one_way:
        parts.append(("does not answer", "doubtful"))
    if link.skew_ppm is not None:
        parts.append(f"clock {link.skew_ppm:+.1f} ppm")
    if link.jitter_p99_ms is not None:
        parts.append(f"jitter p99 {link.jitter_p99_ms:.2f} ms")
    parts.append((link.name, "quiet"))
    return parts


def _losses(state: TrialState) -> list[Part]:
    losses, link = state.link.losses, state.link
    parts: list[Part] = []
    if losses.missing:
        meaning = "bad" if losses.share > LOSS_LIMIT else "doubtful"
        parts.append(
            (
                f"{losses.lost} lost, {losses.rejected} damaged, {losses.dropped} dropped by the object: "
                f"{100 * losses.share:.2f} %",
                meaning,
            )
        )
    else:
        parts.append((f"none of {losses.produced} samples", "good"))
    if link.crc_errors or link.malformed:
        parts.append((f"{_counted(link.crc_errors, 'CRC error')}, {link.malformed} malformed", "doubtful"))
    if link.overflow_chunks:
        parts.append((f"{link.overflow_chunks} chunks not taken in time", "bad"))
    return parts


def _recording(state: TrialState) -> list[Part]:
    recording = state.recording
    if recording.problem:
        return [(recording.problem, "bad")]
    parts: list[Part] = [f"{recording.n_bytes / 1e6:.1f} MB"]
    if recording.free_bytes is not None:
        low = recording.free_bytes < 1e9
        parts.append((f"{recording.free_bytes / 1e9:.1f} GB free", "bad" if low else "plain"))
    parts.append((recording.path, "quiet"))
    return parts


def _counted(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"
