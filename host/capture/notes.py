"""What a person should know of a capture: sentences, each reported once, and the state of the disk."""

from __future__ import annotations

import contextlib
import re
import shutil
from collections.abc import Callable, Iterable

from host.recording.writer import RecordingWriter
from host.screen.screens import Screen
from host.trial.state import RecordingView

DISK_NS = 2_000_000_000
"""Between two measurements of the room on the disk."""


class Notes:
    """Puts warnings on the screen and into the recording, keeps them for the result, and watches the disk."""

    def __init__(self, recording: RecordingWriter, screen: Screen, now_ns: Callable[[], int]) -> None:
        self.warnings: list[str] = []
        """All of them, the newest last."""
        self._recording = recording
        self._screen = screen
        self._now_ns = now_ns
        self._known: set[str] = set()
        self._on_disk = True
        self._measured_ns = 0
        self._free_bytes: int | None = None

    @property
    def recording(self) -> RecordingView:
        """What a screen shows of the recording."""
        recording = self._recording
        return RecordingView(str(recording.path), recording.n_bytes, recording.problem, self._free_bytes)

    def warn(self, sentence: str) -> None:
        """Report a sentence."""
        self.warnings.append(sentence)
        self._screen.report(f"note: {sentence}")
        if not self._recording.closed:  # what is found as it is closed has no place in it any more
            self._recording.add_note("warning", sentence, self._now_ns())

    def warn_once(self, sentences: Iterable[str]) -> None:
        """Report those of the sentences that are new; a count that has grown does not make one new."""
        for sentence in sentences:
            without_numbers = re.sub(r"\d+", "#", sentence)
            if without_numbers not in self._known:
                self._known.add(without_numbers)
                self.warn(sentence)

    def watch_disk(self, now_ns: int) -> None:
        """Report when the recording is no longer, or again, on disk; see how much room there is now and then."""
        problem = self._recording.problem
        if (problem is None) != self._on_disk:
            self._on_disk = problem is None
            self.warn(problem or "the recording is on disk again")
        if now_ns - self._measured_ns >= DISK_NS:
            self._measured_ns = now_ns
            self._free_bytes = None
            with contextlib.suppress(OSError):
                self._free_bytes = shutil.disk_usage(self._recording.path.parent).free
