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

from host.capture.run import DEFAULT_FOLDER, run_capture
from host.capture.settings import CaptureSettings
from host.screen.dashboard.picture import View, picture
from host.screen.screens import QuietScreen
from host.trial.state import TrialState
from host.virtual_object_process import VirtualObjectProcess

WIDTH, HEIGHT = 100, 32
CYCLES = 14
SCENARIO = """
purpose = "Twelve seconds at rest, which tell the sensor's own drift, then cycles of 2 s."
[motion]
period_s = 2.0
swing_deg = 40.0
cycles = 30
lead_in_s = 12.0
[drift]
angle_deg = 0.8
axis = [0.0, 0.6, 0.8]
[imu]
heading_drift_deg_per_min = 0.5
temperature_c = 38.0
[device]
rate_hz = 100
"""
FOLDER = Path(__file__).resolve().parent / "pictures"


class KeepingScreen(QuietScreen):
    """Keeps the last state of the run."""

    state = TrialState()

    def update(self, state: TrialState, index: int = 0) -> None:  # noqa: ARG002 - one object only
        """Keep the state, as long as it is live."""
        if not state.score.finished:
            self.state = state


def dashboard_picture(path: Path) -> None:
    """Capture a trial and draw the dashboard as it stands when the last cycle is in."""
    screen = KeepingScreen()
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        scenario = Path("picture.toml")
        scenario.write_text(SCENARIO, encoding="utf-8")
        with VirtualObjectProcess(str(scenario.resolve())) as virtual:
            recording = DEFAULT_FOLDER / "trial.mcap"
            run_capture(virtual.link, recording, CaptureSettings(cycles=CYCLES), screen, threading.Event())
    console = Console(record=True, width=WIDTH, height=HEIGHT, force_terminal=True, file=io.StringIO())
    for line in picture((screen.state,), View(), WIDTH, HEIGHT):
        console.print(line, no_wrap=True)
    path.parent.mkdir(exist_ok=True)
    without_web_fonts = re.sub(r"@font-face \{\{.*?\}\}", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)
    drawing = console.export_svg(
        title="rotdrift capture", theme=MONOKAI, code_format=without_web_fonts, unique_id="dashboard"
    )
    path.write_text(with_drawn_bars(drawing), encoding="utf-8")


def with_drawn_bars(picture: str) -> str:
    """Draw the bar of θ̄ in place of the combining character, which many monospace fonts put beside the letter."""
    return picture.replace("θ̄", '<tspan text-decoration="overline">θ</tspan>')


if __name__ == "__main__":
    dashboard_picture(FOLDER / "dashboard.svg")
