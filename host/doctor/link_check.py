"""The link check of ``rotdrift doctor LINK``: a handshake, then a capture of some seconds."""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path

from host.capture.loop import Capture, CaptureOutcome
from host.capture.settings import CaptureSettings
from host.clock.estimate import ClockEstimate
from host.doctor.findings import Finding, Verdict, judged
from host.errors import HostError
from host.links import open_stoppable
from host.losses.verdict import LOSS_LIMIT
from host.recording.writer import RecordingWriter
from host.screen.screens import QuietScreen
from host.text import plain
from host.trial.live import Trial

MAX_JITTER_MS = 20.0
RATE_TOLERANCE = 0.02
MAX_SKEW_PPM = 200.0


def check_link(link: str, seconds: float, stop: threading.Event) -> list[Finding]:
    """Open a link, capture for some seconds into a temporary recording, and return what was found.

    The seconds count from the first sample; ``stop`` ends the capture early. The last finding is ``BAD`` if the object
    cannot be captured.
    """
    try:
        transport = open_stoppable(link, stop)
    except HostError as error:
        return [_failed("link", error)]
    trial = Trial()
    with tempfile.TemporaryDirectory(prefix="rotdrift-doctor-") as folder:
        writer = RecordingWriter(Path(folder) / "check.mcap", transport.name, time.time_ns(), time.monotonic_ns())
        settings = CaptureSettings(duration_s=seconds)
        outcome = Capture(transport, writer, trial, QuietScreen(), settings, stop).run()
    return [Finding("link", Verdict.OK, f"{plain(transport.name, 200)} is open"), *_judged_capture(trial, outcome)]


def _judged_capture(trial: Trial, outcome: CaptureOutcome) -> list[Finding]:
    found = [_handshake(trial), *(_measured(trial, outcome) if trial.assembler.segments else ())]
    found += [Finding("warning", Verdict.DOUBTFUL, plain(sentence, 300)) for sentence in outcome.warnings]
    if outcome.error is not None:
        found.append(_failed("capture", outcome.error))
    elif not trial.assembler.segments:
        found.append(Finding("capture", Verdict.BAD, f"no sample came ({outcome.reason})", "wait until it streams"))
    return found


def _failed(topic: str, error: HostError) -> Finding:
    return Finding(topic, Verdict.BAD, plain(error.message, 300), plain(error.remedy, 300))


def _measured(trial: Trial, outcome: CaptureOutcome) -> list[Finding]:
    """Return what the samples of a capture show: rate, jitter, losses and clock."""
    losses = trial.assembler.losses()
    clock = trial.clock_values()
    found = [_rate(trial, losses.received, outcome.elapsed_s)]
    p99, p50 = (None, None) if clock is None else (clock.jitter_p99_ms, clock.jitter_p50_ms)
    if p99 is not None and p50 is not None:
        remedy = "a latency timer, a hub or a busy machine: end points are timed by the object's clock all the same"
        text = f"p50 {p50:.2f} ms, p99 {p99:.2f} ms"
        found.append(judged("jitter", text, good=p99 <= MAX_JITTER_MS, remedy=remedy))
    parts = f"{losses.lost} lost on the link, {losses.rejected} damaged, {losses.dropped} dropped by the object"
    found += [
        judged(
            "losses",
            f"{losses.missing} of {losses.produced} samples ({parts})",
            good=losses.share <= LOSS_LIMIT,
            remedy="try another cable and port, a lower rate, no hub",
            verdict=Verdict.BAD,
        ),
        _skew(trial.clock_estimate),
    ]
    width_ms = None if clock is None else clock.offset_uncertainty_ms
    if width_ms is not None:
        found.append(Finding("clock offset", Verdict.INFO, f"known within {width_ms:.2f} ms"))
    return found


def _rate(trial: Trial, received: int, elapsed_s: float) -> Finding:
    """Compare the rate with the one that the object promised, as far as so short a time can show it."""
    rate_hz = (received - 1) / elapsed_s if elapsed_s > 0 else 0.0
    info = trial.assembler.info
    if info is None:
        return Finding("rate", Verdict.OK, f"{rate_hz:.1f} Hz")
    promised = float(info.rate_hz)
    # One sample more or less at either end is no difference.
    good = abs(rate_hz - promised) <= RATE_TOLERANCE * promised + 2 / max(elapsed_s, 1)
    text = f"{rate_hz:.1f} Hz ({promised:.0f} promised)"
    return judged("rate", text, good=good, remedy="samples are lost, or the object is busy")


def _handshake(trial: Trial) -> Finding:
    info = trial.assembler.info
    if info is None:
        remedy = "it is captured without identity and card"
        return Finding("object", Verdict.DOUBTFUL, "did not say who it is", remedy)
    firmware = ".".join(map(str, info.firmware_version))
    return Finding(
        "object",
        Verdict.OK,
        f"{plain(info.name, 32)} {info.device_id:016x}, firmware {firmware}, protocol "
        f"{info.protocol_major}.{info.protocol_minor}, {plain(info.sensor, 24)}, {plain(info.filter, 24)}",
    )


def _skew(estimate: ClockEstimate | None) -> Finding:
    if estimate is None or estimate.n_bins < 3:
        return Finding("clock skew", Verdict.INFO, "not known after so few seconds")
    # The line of the clock lies below delays of up to about the median jitter: over the time seen, so far may it tilt.
    known_ppm = min(estimate.skew_uncertainty_ppm, 1e-3 * estimate.jitter_p50_ns / (estimate.n_bins - 1))
    text = f"{estimate.skew_ppm:+.0f} ppm, known within about {max(known_ppm, 1):.0f} ppm"
    if known_ppm > MAX_SKEW_PPM:
        return Finding("clock skew", Verdict.INFO, f"{text}: listen longer (--seconds)")
    remedy = "the object's crystal is out of its range; durations are wrong by as much"
    return judged("clock skew", text, good=abs(estimate.skew_ppm) - known_ppm <= MAX_SKEW_PPM, remedy=remedy)
