"""Make the pictures of the documentation from a real run: ``python docs/pictures.py`` (``make docs`` calls it).

A virtual object in a second process, a capture over a real link, the dashboard's last state as an SVG, the report of
the trial as a browser shows it (where there is one), and one of its figures.
"""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

from rich._export_format import CONSOLE_SVG_FORMAT
from rich.console import Console
from rich.terminal_theme import MONOKAI

from host import cli
from host.capture.run import run_capture
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
CARDS = """
[hand]
model = "T42"
maker = "laboratory"
fingers = 2
actuation = "2 motors, tendons, underactuated"
aperture_mm = 90.0
fingertip_material = "urethane rubber"
control_mode = "open loop, position"
[trial]
motion = "roll"
axis = "world x"
repeats = 14
comments = "An emulated trial: the drift is known and built in."
[object]
type = "cube"
name = "virtual cube"
"""
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
PAGE_PX = 900, 820
"""Of the report that the picture shows, width and height."""
FOLDER = Path(__file__).resolve().parent / "pictures"


class KeepingScreen(QuietScreen):
    """Keeps the last state of the run."""

    state = TrialState()

    def update(self, state: TrialState, index: int = 0) -> None:  # noqa: ARG002 - one object only
        """Keep the state, as long as it is live."""
        if not state.score.finished:
            self.state = state


def make_pictures(folder: Path) -> None:
    """Capture a trial; draw the dashboard when the last cycle is in, and what ``report`` makes of the trial."""
    folder.mkdir(exist_ok=True)
    screen = KeepingScreen()
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        scenario = Path("picture.toml")
        scenario.write_text(SCENARIO, encoding="utf-8")
        with VirtualObjectProcess(str(scenario.resolve())) as virtual:
            run_capture(virtual.link, Path("trial.mcap"), CaptureSettings(cycles=CYCLES), screen, threading.Event())
        Path("trial.toml").write_text(CARDS, encoding="utf-8")
        report_pictures(Path("trial.mcap"), folder)
    (folder / "dashboard.svg").write_text(dashboard_picture(screen.state), encoding="utf-8")


def report_pictures(recording: Path, folder: Path) -> None:
    """Draw the first page of a report, and one of its figures."""
    cli.main(["report", str(recording), "--out", "report", "--title", "Rotation drift of an emulated cube"])
    (figure,) = Path("report").glob("trials/*/figures/rotation.svg")
    shutil.copy(figure, folder)
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        sys.stderr.write("no browser: the picture of the report is not made again\n")
        return
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--hide-scrollbars")
    quiet = ("--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run")
    size = f"--window-size={PAGE_PX[0]},{PAGE_PX[1]}"
    shot, page = f"--screenshot={folder / 'report.png'}", Path("report/report.html").resolve().as_uri()
    command = [browser, *options, *quiet, size, "--virtual-time-budget=20000", shot, page]
    subprocess.run(command, check=True, capture_output=True, timeout=120)  # noqa: S603 - our own page


def dashboard_picture(state: TrialState) -> str:
    """Return the dashboard of a state as an SVG."""
    console = Console(record=True, width=WIDTH, height=HEIGHT, force_terminal=True, file=io.StringIO())
    for line in picture((state,), View(), WIDTH, HEIGHT):
        console.print(line, no_wrap=True)
    without_web_fonts = re.sub(r"@font-face \{\{.*?\}\}", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)
    return with_drawn_bars(
        console.export_svg(
            title="rotdrift capture", theme=MONOKAI, code_format=without_web_fonts, unique_id="dashboard"
        )
    )


def with_drawn_bars(picture: str) -> str:
    """Draw the bar of θ̄ in place of the combining character, which many monospace fonts put beside the letter."""
    return picture.replace("θ̄", '<tspan text-decoration="overline">θ</tspan>')


if __name__ == "__main__":
    make_pictures(FOLDER)
