"""A view never ends what it watches: each call of a capture into one of its parts raises, and the trial is still there.

The calls are found by watching a capture, in virtual time; a part or a call that is added later is found as well.
"""

import io
import itertools
import json
import os
import re
import signal
import sys
import threading
from collections import Counter
from unittest.mock import patch

import pytest
from mcap.writer import Writer

from analysis.cycles.online.detector import OnlineCycleDetector
from host.capture import run as capture_run
from host.capture.alarms import AlarmWatch
from host.capture.playback import play, recorded_actions, recorded_commands
from host.capture.run import run_capture
from host.capture.several import capture_several
from host.errors import InternalError
from host.recording import format as fmt
from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from host.recording.recovery import recover, salvage
from host.recording.replay_link import ReplayTransport
from host.recording.sink import RecordingSink
from host.recording.writer import RecordingWriter
from host.results.result import ScoreOptions, score_trial
from host.screen import live_screen
from host.screen.dashboard.theme import Theme
from host.screen.guarded_screen import guarded
from host.screen.live_screen import LiveScreen
from host.screen.pipe import FrameSender, Stop, receive
from host.screen.screens import LineScreen, QuietScreen
from host.stream.session import Session
from host.trial.live import Trial
from host.trial.state import Alarm, TrialState
from tests.injected_faults import calls_counted, raising
from tests.virtual_capture import SETTINGS, KeyedScreen, VirtualCapture, VirtualObjectLink, virtual_links
from tests.waiting import HANG_S, wait_for

MAGIC = b"\x89MCAP0\r\n"
ERRORS = (RuntimeError, RuntimeError, RuntimeError, MemoryError, ZeroDivisionError)
VIEWS = {
    "analysis/cycles/online/": "the cycle detector",
    "host/trial/running_score.py": "the running score",
    "host/trial/sensor.py": "the view of the sensor",
    "host/trial/turning.py": "the turning rate",
    "host/clock/est": "the clock estimate",
    "host/clock/interval.py": "the clock estimate",
    "host/stream/rate.py": "the rate of the samples",
    "host/capture/alarms.py": "the alarms",
    "host/capture/guide.py": "the guide",
    "host/capture/goal.py": "the watch on cycles and time",
    "host/capture/snapshot.py": "the live view",
    "host/capture/operator_desk.py": "the operator's desk",
    "host/screen/screens.py": "the screen",
    "tests/virtual_capture.py": "the screen",
}
"""Files of the parts that only watch -> how their failure is named."""
OTHERS = {
    "_score_view": ("the running score",),
    "_edit": ("the running score",),
}
"""Functions that a part lends to another, which fails then."""
CORE = ("host/stream/", "host/losses/", "host/recording/", "firmware_protocol/", "host/clock/unwrap.py")
"""Files of what records and decodes."""


def view_of(file, function):
    if file.startswith("tests/") and not function.startswith(KeyedScreen.__name__):
        return None
    return next((name for start, name in VIEWS.items() if file.startswith(start)), None)


def core_of(file, function):
    return file.rpartition("/")[0] if file.startswith(CORE) and view_of(file, function) is None else None


def places(part_of, run):
    """Return each call of a run into a part, with the numbers of its first and a middle one, and an error for each."""
    with calls_counted(part_of) as counts:
        run()
    errors = itertools.cycle(ERRORS)
    for call, n in sorted((call, n) for call, n in counts.items() if call.caller.startswith("host/")):
        for number in sorted({1, n // 2 + 1}):
            yield call, number, next(errors)("injected")


class Scores:
    """The score of a recording: computed once for those that have the same data and the same actions."""

    def __init__(self):
        self._known = {}

    def of(self, trial, actions):
        key = len(trial.series), trial.losses, tuple(map(repr, actions))
        if key not in self._known:
            self._known[key] = score_trial(trial, ScoreOptions(clock=True))
        return self._known[key]


@pytest.fixture
def scores():
    return Scores()


def ledger_sums(losses):
    return losses.produced == losses.received + losses.lost + losses.rejected + losses.dropped


def test_whichever_view_fails_the_trial_is_recorded_stopped_and_scored(tmp_path, scores, capsys):
    found = places(view_of, VirtualCapture(tmp_path / "whole.mcap").run)
    parts = Counter()
    for number, (call, nth, error) in enumerate(found):
        path = tmp_path / f"{number}.mcap"
        bench = VirtualCapture(path)
        with raising(view_of, call, nth, error):
            outcome = bench.run()
        where = f"{call}, call {nth}"
        assert outcome.error is None, where
        (sentence,) = outcome.warnings
        name = sentence.partition(" failed (")[0]
        assert name in {call.part, *OTHERS.get(call.function, ())}, f"{where}: {sentence}"
        assert f"{type(error).__name__}: injected" in sentence, where
        shown = bench.screen.lines.getvalue() + capsys.readouterr().err
        assert shown.count(f"note: {sentence}") == 1, where
        assert bench.link.stopped, where
        assert bench.link.closed, where
        assert path.read_bytes().endswith(MAGIC), where
        assert list(RecordingReader(path).chunks()) == bench.link.delivered, where
        trial, live = load_trial(path), bench.trial.assembler.losses()
        assert trial.damage == (), where
        assert trial.losses == live, where
        assert ledger_sums(live), where
        assert live.missing == 14, where
        assert scores.of(trial, recorded_actions(path)).theta_bar_deg == pytest.approx(0.8, abs=0.01), where
        parts[name] += 1
    assert set(parts) == set(VIEWS.values())  # or one of them is no longer called


def test_whatever_fails_in_recording_or_decoding_the_object_is_stopped_and_the_recording_closed(tmp_path):
    found = places(core_of, VirtualCapture(tmp_path / "whole.mcap").run)
    n_ended = 0
    for number, (call, nth, error) in enumerate(found):
        path = tmp_path / f"{number}.mcap"
        bench = VirtualCapture(path)
        with raising(core_of, call, nth, error):
            outcome = bench.run()
        where = f"{call}, call {nth}"
        # What was only asked for a view's sake has failed with that view; the rest ends the capture.
        if outcome.error is not None:
            assert isinstance(outcome.error, InternalError), where
            assert outcome.error.__cause__ is error, where
            assert outcome.error.exit_code == 70, where
            n_ended += 1
        assert len(outcome.warnings) == 1 or call.function == "RecordingWriter.close", where
        assert all(str(error) in sentence for sentence in outcome.warnings), where
        assert bench.link.stopped, where
        assert bench.link.closed, where
        assert bench.writer.closed, where
        recorded = list(RecordingReader(path).chunks())
        unrecorded = [chunk for chunk in bench.link.delivered if chunk not in recorded]
        assert len(unrecorded) <= (call.function == "RecordingWriter.add_received"), where
        assert path.read_bytes().endswith(MAGIC), where
        trial = load_trial(path)
        assert trial.damage == (), where
        assert ledger_sums(trial.losses), where
        if len(trial.series):
            score_trial(trial, ScoreOptions())
    assert n_ended > 40


# ---- what fails again and again, also on the way out ----------------------------------------------------------------


def always(error):
    def raises(*_, **__):
        raise error

    return raises


@pytest.mark.parametrize(
    ("owner", "name"),
    [
        (Trial, "feed"),
        (Trial, "finish"),
        (Session, "feed"),
        (Session, "due"),
        (Session, "stop"),
        (RecordingWriter, "add_received"),
        (RecordingWriter, "add_sent"),
        (RecordingWriter, "add_note"),
        (RecordingWriter, "flush_if_due"),
        (Writer, "finish"),
        (RecordingSink, "removed"),
        (VirtualObjectLink, "take"),
    ],
)
def test_what_fails_on_the_way_out_too_leaves_the_object_stopped_and_the_file_closed(tmp_path, owner, name):
    bench = VirtualCapture(tmp_path / "trial.mcap", batch=3)
    note_on_the_way = name == "add_note"
    with patch.object(owner, name, always(RuntimeError("injected"))):
        if note_on_the_way:
            bench.trial.failures.append("something to note")
        outcome = bench.run()
    assert isinstance(outcome.error, InternalError)
    assert bench.link.stopped
    assert bench.link.closed
    assert bench.writer.closed
    assert bench.writer._sink.closed
    lost = {"add_received", "take"}
    recorded = [chunk.data for chunk in _salvaged(tmp_path / "trial.mcap")]
    assert recorded == ([] if name in lost else [chunk.data for chunk in bench.link.delivered])


def _salvaged(path):
    """Chunks of a file that may lack its end."""
    return [message.chunk for message in salvage(path)[1] if message.topic == fmt.RECEIVED]


@pytest.mark.parametrize("interrupt", [KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize(
    ("owner", "name"),
    [(AlarmWatch, "update"), (KeyedScreen, "update"), (Session, "stop"), (Trial, "finish"), (RecordingWriter, "close")],
)
def test_what_ends_the_program_is_not_swallowed_and_everything_is_closed(tmp_path, interrupt, owner, name):
    bench = VirtualCapture(tmp_path / "trial.mcap")
    n, usual = itertools.count(), getattr(owner, name)

    def once(*arguments):
        if next(n) == 0:
            raise interrupt
        return usual(*arguments)

    with patch.object(owner, name, once), pytest.raises(interrupt):
        bench.run()
    assert bench.link.stopped
    assert bench.link.closed
    assert bench.writer.closed
    assert list(RecordingReader(tmp_path / "trial.mcap").chunks()) == bench.link.delivered


# ---- whole commands -------------------------------------------------------------------------------------------------


def test_a_result_names_what_failed_and_has_the_score(tmp_path):
    link = VirtualObjectLink()
    with virtual_links(link), patch.object(OnlineCycleDetector, "feed", always(ZeroDivisionError("a swing of 0"))):
        screen = KeyedScreen(link)
        finished = run_capture("memory:", tmp_path / "trial.mcap", SETTINGS, screen, threading.Event())
    assert finished.outcome.error is None
    written = json.loads(finished.result.read_text())
    (sentence,) = written["capture"]["warnings"]
    assert re.fullmatch(
        r"the cycle detector failed \(ZeroDivisionError: a swing of 0, at \S+:\d+\) and is switched off: "
        r"no more cycles are counted, so none end the capture",
        sentence,
    )
    assert written["theta_bar_deg"] == pytest.approx(0.8, abs=0.01)
    assert "ALARM no cycles" not in screen.lines.getvalue()  # nobody looks for them


def test_a_failure_of_decoding_is_scored_and_ends_with_exit_code_70(tmp_path):
    link, n = VirtualObjectLink(), itertools.count()
    feed = Trial.feed

    def thirtieth(trial, chunk):
        if next(n) == 40:
            raise RuntimeError("injected")
        return feed(trial, chunk)

    with virtual_links(link), patch.object(Trial, "feed", thirtieth):
        finished = run_capture("memory:", tmp_path / "trial.mcap", SETTINGS, KeyedScreen(link), threading.Event())
    assert finished.outcome.error.exit_code == 70
    assert finished.score.theta_bar_deg == pytest.approx(0.8, abs=0.01)
    assert json.loads(finished.result.read_text())["capture"]["error"].startswith("internal error (RuntimeError")


def test_of_several_objects_the_others_go_on(tmp_path):
    links = [VirtualObjectLink(), VirtualObjectLink()]
    paths = [tmp_path / "one.mcap", tmp_path / "two.mcap"]
    screen = LineScreen(io.StringIO())
    feed = Trial.feed

    def fails_for_one(trial, chunk):
        if threading.current_thread().name == "rotdrift-object-1":
            raise RuntimeError("injected")
        return feed(trial, chunk)

    def picked(link, *_):
        return links[int(link)]

    with virtual_links(), patch.object(capture_run, "open_lasting", picked), patch.object(Trial, "feed", fails_for_one):
        one, two = capture_several(["0", "1"], paths, SETTINGS, screen, threading.Event())
    assert one.exit_code == 70
    assert "injected" in str(one.error)
    assert [chunk.data for chunk in RecordingReader(paths[0]).chunks()] == [chunk.data for chunk in links[0].delivered]
    assert two.exit_code == 0
    assert two.result.theta_bar_deg == pytest.approx(0.8, abs=0.01)
    assert all(link.stopped and link.closed for link in links)


def test_whichever_view_fails_a_recording_is_replayed_and_recovered(tmp_path, capsys):
    whole = tmp_path / "whole.mcap"
    VirtualCapture(whole).run()
    then = recorded_actions(whole), recorded_commands(whole)

    def replay(screen):
        with ReplayTransport(whole, 0.0) as transport:
            return play(transport, Trial(), screen, threading.Event(), 1.0, *then)

    found = places(view_of, lambda: replay(KeyedScreen(VirtualObjectLink())))
    n = 0
    for call, nth, error in found:
        if nth > 1 or call.function.endswith("init__"):  # a part that cannot be made ends it before it starts
            continue
        screen = KeyedScreen(VirtualObjectLink())
        with raising(view_of, call, nth, error):
            state = replay(screen)
        shown = screen.lines.getvalue() + capsys.readouterr().err
        assert state is not None, call
        assert shown.count("note: ") == shown.count(" failed (") == 1, call
        assert len(state.warnings) == (call.part != "the screen"), call
        n += 1
    assert n > 20
    clean = tmp_path / "clean.mcap"
    with patch.object(OnlineCycleDetector, "feed", always(ZeroDivisionError("a swing of 0"))):
        recover(whole, clean)
    assert list(RecordingReader(clean).chunks()) == list(RecordingReader(whole).chunks())
    notes = [message.values()["text"] for message in RecordingReader(clean).messages([fmt.NOTE])]
    assert any("the cycle detector failed" in note for note in notes)


# ---- the screen -----------------------------------------------------------------------------------------------------


def test_a_screen_that_fails_is_stopped_and_lines_follow(capsys):
    class Broken(QuietScreen):
        stopped = 0

        def update(self, *_):
            raise RuntimeError("injected")

        def stop(self):
            self.stopped += 1
            raise RuntimeError("again")

    broken = Broken()
    screen = guarded(broken)
    assert guarded(screen) is screen
    screen.report("before")
    alarmed = TrialState(alarms=(Alarm("losses", "9 % are missing"),))
    screen.update(alarmed)
    screen.report("after")
    screen.stop()
    assert broken.reported == ["before"]
    assert broken.stopped == 1
    assert capsys.readouterr().err.splitlines() == ["ALARM losses: 9 % are missing", "after"]
    (problem,) = screen.problems
    assert problem.startswith("the screen failed (RuntimeError: injected, at test_capture_failures.py:")
    assert screen.hold(10.0)
    assert screen.actions() == []


def test_where_lines_fail_too_nothing_is_shown_and_nothing_ends(monkeypatch):
    class Full(io.StringIO):
        def write(self, _):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(sys, "stderr", Full())
    screen = guarded(LineScreen(Full()))
    screen.report("a sentence")
    screen.report("another")
    screen.stop()
    assert [problem.partition(" failed")[0] for problem in screen.problems] == ["the screen", "standard error"]


def test_a_state_that_cannot_be_sent_ends_the_sender_and_is_reported():
    start, end = io.BytesIO(), []
    start.close = lambda: end.append(start.getvalue())
    sender = FrameSender(start, bell=False)
    sender.update(TrialState(title=threading.Lock()), 0)  # cannot be pickled
    wait_for(lambda: end, "the end of the pipe")
    assert isinstance(sender.failure, TypeError)
    assert receive(io.BytesIO(end[0])) == Stop()


DRAWS = "import sys; sys.stdout.write('{}\\n'); sys.stdout.flush(); sys.stdin.buffer.read()"
"""In place of the process that draws: sends one line that is no action, and ends with its input."""


@pytest.fixture
def live(monkeypatch):
    """A live screen on a pseudo-terminal whose process draws nothing."""
    pty = pytest.importorskip("pty")
    monkeypatch.setattr(live_screen, "command_line", lambda *_: [sys.executable, "-I", "-S", "-c", DRAWS])
    ours, theirs = pty.openpty()
    with os.fdopen(ours, "rb"), os.fdopen(theirs, "w") as stream:
        live = LiveScreen(stream, LineScreen(stream), Theme())
        yield live
        live.stop()
        assert signal.getsignal(signal.SIGTSTP) is signal.SIG_DFL


def fails_alone(live, screen, sentence, capsys):
    assert live.process is None  # it has ended, and the terminal is free
    assert signal.getsignal(signal.SIGTSTP) is signal.SIG_DFL
    (problem,) = screen.problems
    assert problem.startswith(f"the screen failed ({sentence}")
    screen.report("a line")
    assert capsys.readouterr().err == "a line\n"


def test_keys_that_cannot_be_received_end_the_screen_not_the_capture(live, monkeypatch, capsys):
    screen = guarded(live)
    monkeypatch.setattr(live_screen, "decode_action", always(RuntimeError("injected")))
    screen.start()
    assert live.process is not None
    wait_for(lambda: screen.actions() or screen.problems, "the failure")
    fails_alone(live, screen, "RuntimeError: injected", capsys)


def test_a_picture_that_cannot_be_sent_ends_the_screen_not_the_capture(live, capsys):
    screen = guarded(live)
    screen.start()
    screen.update(TrialState(title=threading.Lock()))
    wait_for(lambda: live._frames.failure, "the failure")  # a newer state might be sent in place of this one
    screen.update(TrialState())
    fails_alone(live, screen, "TypeError: ", capsys)


def test_a_process_that_dies_is_named_in_the_warnings_too(live):
    screen = guarded(live)
    screen.start()
    assert screen.problems == ()
    live.process.kill()
    live.process.wait(HANG_S)
    screen.update(TrialState())
    assert screen.problems == ("the screen failed; the capture goes on with a line per cycle",)


@pytest.mark.parametrize("name", ["command_line", "FrameSender"])
def test_a_screen_that_cannot_start_leaves_no_process_and_no_handler(live, name, monkeypatch, capsys):
    screen = guarded(live)
    monkeypatch.setattr(live_screen, name, always(RuntimeError("injected")))
    screen.start()
    fails_alone(live, screen, "RuntimeError: injected", capsys)
