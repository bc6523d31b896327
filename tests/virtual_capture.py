"""A capture in virtual time: the emulator's object on a link in memory, a clock that reads move, keys by the clock.

It imitates neither threads nor drivers nor the speed of a machine; everything else of a capture is the real thing.
"""

import io
import threading
from contextlib import contextmanager
from unittest.mock import patch

from emulator.virtual_object import VirtualObject
from firmware_protocol.packets import Stop
from firmware_protocol.serial.decoder import StreamDecoder
from host.capture import conversation
from host.capture import run as capture_run
from host.capture.guide import GuideSettings
from host.capture.loop import Capture
from host.capture.settings import CaptureSettings
from host.links.transport import Chunk, Transport
from host.recording.writer import RecordingWriter
from host.screen.guarded_screen import GuardedScreen
from host.screen.keys import ScreenAction
from host.screen.screens import LineScreen
from host.stream.session import SessionSettings
from host.trial.live import Trial
from tests.memory_link import MemoryLink
from tests.recorded_trials import MONOTONIC_NS, WALL_NS, scenario

STEP_NS = 70_000_000
"""What one read of the link takes."""
MOTION = {"cycles": 5, "period_s": 0.4, "swing_deg": 20.0, "lead_in_s": 0.4, "lead_out_s": 1.5}
KEYS = (
    (0.2, ScreenAction("window")),
    (0.3, ScreenAction("marker")),
    (1.4, ScreenAction("exclude", 0, "dropped", 1)),
    (1.5, ScreenAction("include", 0, "", 1)),
    (1.6, ScreenAction("note", 0, "odd")),
    (2.7, ScreenAction("window")),
    (3.7, ScreenAction("finish")),
)
"""(s since the start, what a person asks for)."""
SETTINGS = CaptureSettings(
    cycles=3,
    duration_s=3.6,
    guide=GuideSettings(rest_s=0.2, cycles=3),
    session=SessionSettings(time_request_s=0.3),
)
"""Ends when the guide is done; without a part of this, after its cycles, its time, or by the key."""


class VirtualObjectLink(Transport):
    """An object in virtual time, and the reading thread of its link in one: reading moves the clock.

    Of its chunks, ``lost`` ones (numbers) never arrive, and ``batch`` are handed over at once, as on a busy machine.
    """

    name = "memory:"

    def __init__(self, lost=(), batch=1):
        self.now_ns = MONOTONIC_NS
        self.delivered = []
        self.written = []
        self.closed = False
        self.ended, self.error, self.overflow_chunks = False, None, 0
        self._lost = set(lost)
        self._batch = batch
        self._waiting = []
        self._steps = 0
        self._virtual = VirtualObject(scenario("ideal", motion=MOTION))
        self._wire = MemoryLink()
        self._wire.open()

    @property
    def elapsed_s(self):
        return (self.now_ns - MONOTONIC_NS) / 1e9

    @property
    def stopped(self):
        """Whether STOP was sent."""
        return any(isinstance(item, Stop) for data in self.written for item in StreamDecoder().feed(data))

    def read(self, timeout_s):
        del timeout_s
        raise AssertionError("there is no reading thread here")

    def write(self, data):
        self.written.append(data)
        self._wire.put_bytes(data)

    def close(self):
        self.closed = True

    # As the capture uses its reading thread.

    def start(self):
        pass

    def take(self, timeout_s):
        if timeout_s == 0:
            return self._handed_over()
        self.now_ns += STEP_NS
        self._steps += 1
        for command in self._wire.receive():
            self._virtual.firmware.receive(command, self.elapsed_s)
        self._virtual.firmware.step(self.elapsed_s, self._wire.send)
        data = self._wire.take()
        if data and self._steps not in self._lost:
            self._waiting.append(Chunk(data, self.now_ns))
        return self._handed_over() if len(self._waiting) >= self._batch else []

    def _handed_over(self):
        chunks, self._waiting = self._waiting, []
        self.delivered += chunks
        return chunks

    def stop(self):
        self.close()


class KeyedScreen(LineScreen):
    """Lines in memory, and a person who presses keys by the clock of the link."""

    def __init__(self, link):
        self.lines = io.StringIO()
        super().__init__(self.lines)
        self._link = link
        self._keys = list(KEYS)

    def start(self):
        return super().start()

    def update(self, state, index=0):
        return super().update(state, index)

    def cycle(self, row, index=None):
        return super().cycle(row, index)

    def report(self, sentence):
        return super().report(sentence)

    def actions(self):
        due = [action for at_s, action in self._keys if at_s <= self._link.elapsed_s]
        self._keys = self._keys[len(due) :]
        return due

    def stop(self):
        return super().stop()


class VirtualCapture:
    """A capture of such an object into ``path``."""

    def __init__(self, path, settings=SETTINGS, lost=(14, 24), batch=1):
        self.link = VirtualObjectLink(lost, batch)
        self.screen = KeyedScreen(self.link)
        self.trial = Trial()
        self.writer = RecordingWriter(path, self.link.name, WALL_NS, MONOTONIC_NS)
        with patch.object(conversation, "ReaderThread", lambda transport, **_: transport):
            self.capture = Capture(
                self.link,
                self.writer,
                self.trial,
                GuardedScreen(self.screen),
                settings,
                threading.Event(),
                lambda: self.link.now_ns,
            )

    def run(self):
        return self.capture.run()


@contextmanager
def virtual_links(*links):
    """Have every capture that is started by a command, one after the other, find these in place of real links."""
    waiting = list(links)

    def capture(transport, *arguments):
        return Capture(transport, *arguments, now_ns=lambda: transport.now_ns)

    with (
        patch.object(conversation, "ReaderThread", lambda transport, **_: transport),
        patch.object(capture_run, "open_lasting", lambda *_: waiting.pop(0)),
        patch.object(capture_run, "Capture", capture),
    ):
        yield
