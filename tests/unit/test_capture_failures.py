"""A view never ends what it watches: each call of a capture into one of its parts raises, and the trial is still there.

The calls are found by watching a capture, in virtual time; a part or a call that is added later is found as well.
"""

import itertools
from collections import Counter

import pytest

from host.capture.playback import recorded_actions
from host.errors import InternalError
from host.recording.load import load_trial
from host.recording.reader import RecordingReader
from host.results.result import ScoreOptions, score_trial
from tests.injected_faults import calls_counted, raising
from tests.virtual_capture import KeyedScreen, VirtualCapture

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
        assert live.missing == 12, where
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
