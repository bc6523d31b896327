"""The alarms of a trial, in virtual time and along the path of a replay: chunks, trial, watch, screen."""

import threading

from host.capture.playback import play
from host.screen.screens import QuietScreen
from host.trial.live import Trial
from tests.memory_transport import MemoryTransport


class AlarmLog(QuietScreen):
    """A screen that keeps every alarm: when it came up and went, and its sentence."""

    def __init__(self):
        super().__init__()
        self.raised = []
        """(s, kind, sentence) where an alarm came up."""
        self.cleared = []
        """(s, kind) where it was gone."""
        self._up = ()

    def update(self, state, index=0):
        del index
        kinds = tuple(alarm.kind for alarm in state.alarms)
        self.raised += [
            (state.elapsed_s, alarm.kind, alarm.sentence) for alarm in state.alarms if alarm.kind not in self._up
        ]
        self.cleared += [(state.elapsed_s, kind) for kind in self._up if kind not in kinds]
        self._up = kinds

    @property
    def kinds(self):
        return [kind for _, kind, _ in self.raised]


def watched(chunks, baseline=None):
    """Run a trial over chunks; return the log of its alarms and its last state."""
    log = AlarmLog()
    state = play(MemoryTransport(chunks, ends=True), Trial(baseline=baseline), log, threading.Event(), speed=1.0)
    return log, state
