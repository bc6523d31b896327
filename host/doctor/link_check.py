"""What ``rotdrift doctor LINK`` finds on a link: a handshake, and some seconds of what a capture would see."""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path

from host.capture.loop import Capture, CaptureOutcome, CaptureSettings
from host.clock.device_clock import ClockEstimate
from host.doctor.findings import Finding, Verdict, judged
from host.errors import HostError
from host.links import open_transport
from host.losses.verdict import LOSS_LIMIT
from host.recording.writer import RecordingWriter
from host.screen.screens import QuietScreen
from host.text import plain
from host.trial.live import Trial
from host.trial.state import LinkView

SECONDS = 5.0
MAX_JITTER_MS = 20.0
RATE_TOLERANCE = 0.02
MAX_SKEW_PPM = 200.0


def check_link(link: str, seconds: float = SECONDS, stop: threading.Event | None = None) -> list[Finding]:
    """Open a link and capture for some seconds, into a recording that is thrown away.

    Parameters
    ----------
    link : str
        URI.
    seconds : float
        How long, from the first sample.
    stop : threading.Event, optional
        Ends it early.

    Returns
    -------
    list of Finding
        The last one is ``BAD`` if the object cannot be captured.
    """
    try:
        transport = open_transport(link)
    except HostError as error:
        return [Finding("link", Verdict.BAD, plain(error.message, 300), plain(error.remedy, 300))]
    trial = Trial()
    with tempfile.TemporaryDirectory(prefix="rotdrift-doctor-") as folder:
        writer = RecordingWriter(Path(folder) / "check.mcap", transport.name, time.time_ns(), time.monotonic_ns())
        settings = CaptureSettings(duration_s=seconds)
        outcome = Capture(transport, writer, trial, QuietScreen(), settings, stop or threading.Event()).run()
    return [Finding("link", Verdict.OK, f"{plain(transport.name, 200)} is open"), *_judged_capture(trial, outcome)]


def _judged_capture(trial: Trial, outcome: CaptureOutcome) -> list[Finding]:
    found = [_handshake(trial)]
    if trial.assembler.segments:
        view = trial.state(time.monotonic_ns(), outcome.elapsed_s, LinkView(), ()).link
        losses, info, values = view.losses, trial.assembler.info, trial.clock_values() or {}
        rate_hz = (losses.received - 1) / outcome.elapsed_s if outcome.elapsed_s > 0 else 0.0
        promised = None if info is None else float(info.rate_hz)
        close = promised is None or abs(rate_hz - promised) <= RATE_TOLERANCE * promised + 2 / max(outcome.elapsed_s, 1)
        wanted = "" if promised is None else f" ({promised:.0f} promised)"
        found.append(
            judged("rate", f"{rate_hz:.1f} Hz{wanted}", good=close, remedy="samples are lost, or the object is busy")
        )
        p99 = values.get("jitter_p99_ms")
        p50 = values.get("jitter_p50_ms")
        if p99 is not None and p50 is not None:
            remedy = "a latency timer, a hub or a busy machine: end points are timed by the object's clock all the same"
            found.append(judged("jitter", f"p50 {p50:.2f} ms, p99 {p99:.2f} ms", good=p99 <= MAX_JITTER_MS, remedy=remedy))
        parts = f"{losses.lost} lost on the link, {losses.rejected} damaged, {losses.dropped} dropped by the object"
        found.append(
            judged(
                "losses",
                f"{losses.missing} of {losses.produced} samples ({parts})",
                good=losses.share <= LOSS_LIMIT,
                remedy="try another cable and port, a lower rate, no hub",
                verdict=Verdict.BAD,
            )
        )
        found.append(_skew(trial.clock_estimate))
        width_ms = values.get("offset_uncertainty_ms")
        if width_ms is not None:
            found.append(Finding("clock offset", Verdict.INFO, f"known within {width_ms:.2f} ms"))
    found += [Finding("warning", Verdict.DOUBTFUL, plain(sentence, 300)) for sentence in outcome.warnings]
    if outcome.error is not None:
        found.append(Finding("capture", Verdict.BAD, plain(outcome.error.message, 300), plain(outcome.error.remedy, 300)))
    elif not trial.assembler.segments:
        found.append(Finding("capture", Verdict.BAD, f"no sample came ({outcome.reason})", "wait until it streams"))
    return found


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
    # What the link usually adds, over the time that was listened to: how far the line may be turned.
    known_ppm = min(estimate.skew_uncertainty_ppm, 1e-3 * estimate.jitter_p50_ns / (estimate.n_bins - 1))
    text = f"{estimate.skew_ppm:+.0f} ppm, known within about {max(known_ppm, 1):.0f} ppm"
    if known_ppm > MAX_SKEW_PPM:
        return Finding("clock skew", Verdict.INFO, f"{text}: listen longer (--seconds)")
    remedy = "the object's crystal is out of its range; durations are wrong by as much"
    return judged("clock skew", text, good=abs(estimate.skew_ppm) - known_ppm <= MAX_SKEW_PPM, remedy=remedy)
