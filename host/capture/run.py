"""A whole capture for a command: open, record, score, write the result beside the recording."""

from __future__ import annotations

import contextlib
import importlib
import threading
import time
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from analysis.scoring.recorded_parts import CaptureAccount
from analysis.scoring.result import Result
from analysis.sensor.baseline import StaticBaseline
from analysis.series import AnalysisError
from host.capture.loop import Capture, CaptureOutcome
from host.capture.settings import CaptureSettings
from host.capture.snapshot import finished_state
from host.errors import FileError, InternalError, LinkError, already_there, unreadable
from host.links import open_lasting
from host.links.link_log import LinkLog
from host.recording.load import load_trial
from host.recording.writer import RecordingWriter
from host.results.result import ScoreOptions, score_trial, write_result
from host.screen.guarded_screen import guarded
from host.screen.screens import Screen
from host.trial.guarded import Guarded
from host.trial.live import Trial

DEFAULT_FOLDER = Path("rotdrift-trials")
HOLD_S = 3600.0
"""How long the result of a guided trial stays on the screen."""


@dataclass(frozen=True, slots=True)
class FinishedCapture:
    """What a capture left behind."""

    outcome: CaptureOutcome
    score: Result
    recording: Path
    result: Path
    """Where the result was to be written; the disk may be full."""

    def places(self) -> tuple[tuple[str, str], ...]:
        """Return where the files are, a name and a path each."""
        result = (("result", str(self.result)),) if self.result.exists() else ()
        return ("recording", str(self.recording)), *result


def default_recording(now: datetime, folder: Path = DEFAULT_FOLDER) -> Path:
    """Return a name that does not exist yet: the date and time of the start."""
    # Milliseconds, because two captures may well be started in the same second.
    stem = f"{now:%Y-%m-%d_%H-%M-%S}-{now.microsecond // 1000:03d}"
    for number in range(1, 1000):
        path = folder / (f"{stem}.mcap" if number == 1 else f"{stem}_{number}.mcap")
        if not path.exists() and not path.with_suffix(".json").exists():
            return path
    raise FileError(f"{folder} has a thousand recordings of {stem}", "give a name with --out")


def run_capture(
    link: str,
    recording_path: Path,
    settings: CaptureSettings,
    screen: Screen,
    stop: threading.Event,
    options: ScoreOptions | None = None,
) -> FinishedCapture:
    """Capture one trial and score it.

    Parameters
    ----------
    recording_path : Path
        Must not exist; the result goes beside it, with the ending ``.json``.
    screen : Screen
        Started and stopped here.
    stop : threading.Event
        Ends the capture in order.

    Raises
    ------
    LinkError
        The link cannot be opened, or nothing to score came from it.
    FileError
        Recording or result exist already, or the recording cannot be written. Where only the result cannot be, the
        outcome has the error.
    """
    result_path = recording_path.with_suffix(".json")
    for path in (recording_path, result_path):  # before an object is started for it
        if path.exists():
            raise already_there(path)
    options = options or ScoreOptions()
    baseline = None if options.baseline is None else _baseline(options.baseline)
    screen, failures = guarded(screen), list[str]()
    try:
        outcome = record(link, recording_path, settings, screen, stop, baseline)
        finished = _finish(outcome, recording_path, result_path, options)
        last = Guarded("the live view", outcome.last_state, failures, "the result is in its file")
        screen.update(last.ask(lambda state: finished_state(state, finished.score), outcome.last_state))
        for sentence in failures:
            screen.report(sentence)
        if settings.guide is not None:
            end_s = time.monotonic() + HOLD_S
            while not stop.is_set() and time.monotonic() < end_s and not screen.hold(0.2):
                pass
    finally:
        screen.stop()
    return finished


def _baseline(path: Path) -> StaticBaseline:
    """Load a baseline for the live view, before a minute is spent on a trial that cannot use it."""
    from analysis.sensor.baseline_file import load_baseline

    try:
        return load_baseline(path)
    except FileNotFoundError as error:
        raise unreadable(path, error) from error
    except (AnalysisError, OSError) as error:
        raise FileError(f"the baseline {path} cannot be used ({error})", "measure one: `rotdrift baseline`") from error


def record(
    link: str,
    recording_path: Path,
    settings: CaptureSettings,
    screen: Screen,
    stop: threading.Event,
    baseline: StaticBaseline | None = None,
) -> CaptureOutcome:
    """Capture one recording, without scoring it.

    The parameters are those of :func:`run_capture`; the screen is started here, and is for the caller to stop.
    ``baseline`` is that of the sensor, for the floor that the live view shows.

    Raises
    ------
    LinkError
        The link cannot be opened, or not a single sample came from it.
    FileError
        The recording exists already or cannot be written.
    InternalError
        Decoding or recording failed before the first sample; the recording is kept.
    """
    screen = guarded(screen)
    with contextlib.ExitStack() as until_captured:
        transport = open_lasting(link, settings.reconnect_s, stop)
        until_captured.callback(lambda: transport.close())  # whichever it is by then
        if settings.debug_link is not None:
            transport = LinkLog(transport, settings.debug_link)
        wall_ns, monotonic_ns = time.time_ns(), time.monotonic_ns()
        described: dict[str, Any] = {
            "cycles": settings.cycles,
            "duration_s": settings.duration_s,
            "rate_hz": settings.session.rate_hz,
            "until_half_width_deg": settings.until_half_width_deg,
        }
        if transport.interface_name:
            described["interface"] = transport.interface_name
        made_for_it = [folder for folder in recording_path.parents if not folder.exists()]
        writer = RecordingWriter(recording_path, transport.name, wall_ns, monotonic_ns, described)
        until_captured.callback(writer.close)
        trial = Trial(transport.node, settings.until_half_width_deg, baseline)
        imports = threading.Thread(target=_load_slow_modules, name="rotdrift-imports", daemon=True)
        imports.start()
        screen.start()
        capture = Capture(transport, writer, trial, screen, settings, stop)
        until_captured.pop_all()  # both are the capture's from here on
    outcome = capture.run()
    if not trial.assembler.segments:
        if not isinstance(outcome.error, InternalError):  # so that the next try may have its name
            with contextlib.suppress(OSError):
                recording_path.unlink()
                for folder in made_for_it:
                    folder.rmdir()
        raise outcome.error or LinkError(
            f"the capture ended before the first sample ({outcome.reason})", "wait until the object streams"
        )
    imports.join()  # two threads in the same import can see it half done
    return outcome


def _finish(outcome: CaptureOutcome, recording_path: Path, result_path: Path, options: ScoreOptions) -> FinishedCapture:
    captured = CaptureAccount(
        recording=str(recording_path),
        ended=outcome.reason,
        error=None if outcome.error is None else str(outcome.error),
        warnings=outcome.warnings,
        elapsed_s=outcome.elapsed_s,
        clock=outcome.clock,
        live_theta_bar_deg=outcome.last_state.score.theta_bar_deg,
    )
    try:
        score = score_trial(load_trial(recording_path, outcome.unwritten), replace(options, clock=True), captured)
    except AnalysisError as error:
        raise FileError(f"{recording_path} cannot be scored ({error})", "the recording is kept") from error
    try:
        write_result(score, result_path)
    except FileError as error:  # on a full disk the score is still shown
        outcome = replace(outcome, error=outcome.error or error)
    return FinishedCapture(outcome, score, recording_path, result_path)


def _load_slow_modules() -> None:
    """Import beside the capture what would otherwise be imported in the middle of it, and stall it for a second."""
    with contextlib.suppress(Exception):  # what does not load here is reported where it is needed
        for name in ("scipy.ndimage", "scipy.stats"):
            importlib.import_module(name)
