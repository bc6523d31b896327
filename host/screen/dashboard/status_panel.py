"""Motion, sensor, link, clock, losses and recording: one line each.

Where a line has no room for all its parts, the least important are left out rather than cut.
"""

from __future__ import annotations

from host.screen.dashboard.boxes import Lines, end_of, framed
from host.screen.dashboard.theme import Part, Theme, counted
from host.trial.state import TrialState

HEIGHT = 8
RATE_TOLERANCE = 0.05
"""Relative difference from the expected rate that is marked."""
LOSS_LIMIT = 0.01
"""Share of missing samples that is marked as bad."""
SILENCE_S = 1.0
"""So long without a sample is worth a word."""
NAME_WIDTH, PHASE_CELLS = 10, 6
COUNTERS = {
    "refused": "refused",
    "unnumbered": "unnumbered",
    "misnumbered": "misnumbered",
    "wrong_lengths": "wrong length",
    "damaged_batches": "damaged batches",
    "long_packet_errors": "long packets failed",
    "error_frames": "error frames",
    "remote_frames": "remote frames",
    "cobs_errors": "framing errors",
    "oversize": "oversized",
    "unsupported_versions": "unsupported versions",
    "unknown_types": "unknown types",
}
"""Counter of the decoder -> its name in the line of the link, the gravest first; two more stand in that of losses."""


def status_panel(state: TrialState, theme: Theme, width: int) -> Lines:
    """Draw the panel; its height is :data:`HEIGHT`."""
    room = max(10, width - 4 - NAME_WIDTH)
    rows = (
        ("motion", _motion(state, theme)),
        ("sensor", _sensor(state)),
        ("link", _link(state, room, theme)),
        ("clock", _clock(state)),
        ("losses", _losses(state)),
        ("recording", _recording(state, room, theme)),
    )
    lines = [
        theme.join((f"{name:{NAME_WIDTH}}", "quiet")).append_text(theme.listed(parts, room)) for name, parts in rows
    ]
    return framed(lines, "", width, HEIGHT, theme)


def _phase_bar(share: float, theme: Theme) -> str:
    """Draw how much of a cycle is done, 0-1."""
    done = min(PHASE_CELLS, max(0, int(share * PHASE_CELLS)))
    full, empty = ("=", ".") if theme.ascii_only else ("▪", "·")
    return full * done + empty * (PHASE_CELLS - done)


def _motion(state: TrialState, theme: Theme) -> list[Part]:
    motion = state.motion
    of_period = "" if motion.period_s is None else f" of {_short(motion.period_s)} s"
    if motion.cycle_phase is not None:
        parts: list[Part] = [f"{motion.phase} {_phase_bar(motion.cycle_phase, theme)}{of_period}"]
    else:
        parts = [motion.phase, of_period and f"period{of_period.removeprefix(' of')}"]
    # At rest it turns about no axis at all, and that is as it should be.
    flags = [flag for flag in motion.flags if not (motion.at_rest and flag == "axis ambiguous")]
    parts += [
        (", ".join(flags), "doubtful"),
        "" if motion.swing_deg is None else f"swing {_short(motion.swing_deg, 1)}°",
    ]
    if state.sensor.orientation_wxyz is not None:
        parts.append((f"q {theme.vector(state.sensor.orientation_wxyz, 2)}", "quiet"))
    return parts


def _sensor(state: TrialState) -> list[Part]:
    sensor = state.sensor
    if sensor.still is None:
        return ["no data yet"]
    parts: list[Part] = [
        "still" if sensor.still else "moving",
        ("SATURATED" if sensor.saturated else "", "bad"),
        "" if sensor.temperature_c is None else f"{sensor.temperature_c:.0f} °C",
        "" if sensor.battery_v is None else f"{sensor.battery_v:.1f} V",
    ]
    if sensor.heading_deg_per_min is None:
        parts.append(("no baseline", "quiet"))
    else:
        parts.append("" if sensor.floor_deg is None else f"floor {sensor.floor_deg:.2g}°/cycle")
        parts.append(f"drifts {sensor.heading_deg_per_min:.2g}°/min")
    return [*parts, ("uncalibrated" if sensor.calibrated is False else "", "doubtful")]


def outage(state: TrialState) -> str:
    """Return why nothing comes, in a few words; empty while something does."""
    if not state.link.connected:
        return "DISCONNECTED"
    return f"silent for {state.stream.silent_s:.0f} s" if state.stream.silent_s > SILENCE_S else ""


def _link(state: TrialState, room: int, theme: Theme) -> list[Part]:
    link, stream = state.link, state.stream
    rate = "- Hz" if stream.rate_hz is None else f"{stream.rate_hz:.1f} Hz"
    off = False
    if link.expected_rate_hz is not None:
        rate += f" of {link.expected_rate_hz:.0f}"
        off = stream.rate_hz is not None and abs(stream.rate_hz / link.expected_rate_hz - 1) > RATE_TOLERANCE
    resets = stream.segments - 1
    parts: list[Part] = [
        (rate, "doubtful" if off else "plain"),
        (outage(state), "bad"),
        (f"{counted(link.overflow_chunks, 'chunk')} not received in time" if link.overflow_chunks else "", "bad"),
        (counted(stream.reconnects, "reconnect") if stream.reconnects else "", "doubtful"),
        ("" if resets < 1 else stream.segment_reason if resets == 1 else counted(resets, "reset"), "doubtful"),
    ]
    counts = ((name, getattr(stream.counters, counter)) for counter, name in COUNTERS.items())
    parts += [(f"{name} {n}", "doubtful") for name, n in counts if n]
    return [
        *parts,
        ("does not answer" if link.one_way else "", "doubtful"),
        ("" if stream.reconnects else "0 reconnects", "quiet"),
        (end_of(link.name, max(12, room - len("1000.0 Hz of 1000 · 10 reconnects · ")), theme), "quiet"),
    ]


def _clock(state: TrialState) -> list[Part]:
    """Return how the object's clock runs against the host's, and how unevenly the link delivers."""
    clock = state.clock
    if clock.jitter_p99_ms is None:
        return ["no data yet"]
    parts: list[Part] = [("warming up", "quiet") if clock.skew_ppm is None else f"skew {clock.skew_ppm:+.1f} ppm"]
    middle = "" if clock.jitter_p50_ms is None else f"p50 {clock.jitter_p50_ms:.2f}, "
    parts.append(f"jitter {middle}p99 {clock.jitter_p99_ms:.2f} ms")
    if clock.offset_interval_ns is None:
        parts.append(("offset unknown", "quiet"))
    else:
        low_ns, high_ns = clock.offset_interval_ns
        parts.append(f"offset ±{0.5e-6 * abs(high_ns - low_ns):.2f} ms")
    if clock.skew_ppm is not None and clock.warm_up_s is not None:
        parts.append((f"warm after {clock.warm_up_s:.0f} s", "quiet"))
    return parts


def _losses(state: TrialState) -> list[Part]:
    losses, counters = state.stream.losses, state.stream.counters
    if not losses.produced:
        return ["no data yet"]
    parts: list[Part] = [(f"none of {losses.produced} samples", "good")]
    if losses.missing:
        causes = f"{losses.lost} lost, {losses.rejected} damaged, {losses.dropped} dropped"
        if losses.damaged_in_file:  # of a replay; first, where a narrow terminal still shows it
            causes = f"{losses.damaged_in_file} damaged in the file, {causes}"
        meaning = "bad" if losses.share > LOSS_LIMIT else "doubtful"
        parts = [(f"{100 * losses.share:.2f} % missing: {causes}", meaning)]
    if not state.link.name.startswith("can:"):  # a CAN controller checks frames by itself and reports none
        parts.append((counted(counters.crc_errors, "CRC error"), "doubtful" if counters.crc_errors else "quiet"))
    return [*parts, (f"{counters.malformed} malformed" if counters.malformed else "", "doubtful")]


def _recording(state: TrialState, room: int, theme: Theme) -> list[Part]:
    recording = state.recording
    if recording.problem:
        return [(recording.problem, "bad")]
    parts: list[Part] = [f"{recording.n_bytes / 1e6:.1f} MB"]
    used = len("9999.9 MB")
    if recording.free_bytes is not None:
        free = f"{recording.free_bytes / 1e9:.1f} GB free"
        parts.append((free, "bad" if recording.free_bytes < 1e9 else "plain"))
        used += 3 + len(free)
    parts.append((end_of(recording.path, max(12, room - used - 3), theme), "quiet"))
    return parts


def _short(value: float, places: int = 2) -> str:
    """Write a number so that it keeps its width from 1 to 999."""
    whole = len(str(int(abs(value))))
    return f"{value:.{max(0, places + 1 - whole)}f}"
