"""Make the pictures of the documentation from a real run: ``python docs/pictures.py`` (``make docs`` calls it).

A virtual object in a second process, a capture over a real link, and the dashboard's last state as an SVG.
"""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
import threading
from pathlib import Path

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console
from rich.terminal_theme import MONOKAI

from host.capture.loop import CaptureSettings
from host.capture.run import DEFAULT_FOLDER, run_capture
from host.dashboard import render
from host.screen.screens import QuietScreen
from host.trial_state import TrialState
from host.virtual_object_process import VirtualObjectProcess

WIDTH, HEIGHT = 100, 30
CYCLES = 10
FOLDER = Path(__file__).resolve().parent / "pictures"


class KeepingScreen(QuietScreen):
    """Keeps the last state of the run."""

    state = TrialState()

    def update(self, state: TrialState, index: int = 0) -> None:  # noqa: ARG002 - one object only
        """Keep the state, as long as it is live."""
        if not state.finished:
            self.state = state


def dashboard_picture(path: Path) -> None:
    """Capture the default scenario and draw the dashboard as it stands when the last cycle is in."""
    screen = KeepingScreen()
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.chdir(folder),
        VirtualObjectProcess("default") as virtual,
    ):
        recording = DEFAULT_FOLDER / "trial.mcap"
        run_capture(virtual.link, recording, CaptureSettings(cycles=CYCLES), screen, threading.Event())
    console = Console(record=True, width=WIDTH, height=HEIGHT, force_terminal=True, file=io.StringIO())
    console.print(render(screen.state))
    path.parent.mkdir(exist_ok=True)
    without_web_fonts = re.sub(r"@font-face \{\{.*?\}\}", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)
    picture = console.export_svg(
        title="rotdrift capture", theme=MONOKAI, code_format=without_web_fonts, unique_id="dashboard"
    )
    path.write_text(with_drawn_bars(picture), encoding="utf-8")


def with_drawn_bars(picture: str) -> str:
    """Draw the bar of θ̄ in place of the combining character, which many monospace fonts put beside the letter."""
    return picture.replace("θ̄", '<tspan text-decoration="overline">θ</tspan>')


if __name__ == "__main__":
    dashboard_picture(FOLDER / "dashboard.svg")
