"""Moments of trials for the snapshots of the dashboard: `python -m tests.unit.dashboard_states` draws them anew."""

import io
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.console import Console

from analysis.geometry import rotations
from host.losses.ledger import LossReport
from host.screen.dashboard.picture import Theme, View, picture
from host.trial.state import (
    MISSED,
    OUTSIDE,
    Alarm,
    ClockView,
    CounterView,
    CycleRow,
    GuideView,
    LinkView,
    MotionView,
    OperatorMark,
    RecordingView,
    ScoreView,
    SensorView,
    StreamView,
    TargetView,
    TrialState,
    WindowView,
)

FOLDER = Path(__file__).resolve().parent / "snapshots"


def cycles(n, step_deg=0.8):
    rows, quat = [], np.array([1.0, 0.0, 0.0, 0.0])
    for k in range(n):
        turn = math.radians(step_deg) * np.array([0.1 * math.sin(k), 0.6, 0.8 + 0.1 * math.cos(2 * k)])
        angle = float(np.linalg.norm(turn))
        if k:
            quat = rotations.multiply(rotations.exp(turn), quat)
        rows.append(
            CycleRow(
                number=k,
                time_s=6.0 + 4.0 * k,
                period_s=4.0 if k else None,
                step_deg=math.degrees(angle) if k else None,
                step_axis=tuple(float(part) for part in turn / angle) if k else None,
                theta_bar_deg=0.8 if k else None,
                flags=("odd spacing",) if k == 4 else (),
                quat_wxyz=tuple(float(part) for part in quat),
                excluded="hand paused" if k == 6 else "",
            )
        )
    return tuple(rows)


NOTHING = TrialState(title="rotdrift capture", target=TargetView(cycles=20))
ROWS = cycles(12)
RUNNING = TrialState(
    title="rotdrift capture",
    elapsed_s=61.0,
    target=TargetView(cycles=20, half_width_deg=0.15),
    score=ScoreView(
        n_endpoints=11,
        cycles=ROWS,
        theta_bar_deg=0.8125,
        interval_deg=(0.61, 1.01),
        half_width_deg=0.2,
        more_cycles=6,
        origin_wxyz=ROWS[0].quat_wxyz,
    ),
    motion=MotionView("running", True, 4.0, 40.0, 0.6, (), 21.0),
    sensor=SensorView(
        name="[red]cube[/red]",
        still=False,
        temperature_c=31.2,
        battery_v=3.9,
        orientation_wxyz=(0.9, 0.1, -0.4, 0.14),
        heading_deg_per_min=0.5,
        floor_deg=0.05,
    ),
    stream=StreamView(rate_hz=99.9, losses=LossReport(6100, 6100), segments=1),
    clock=ClockView(
        skew_ppm=12.3,
        jitter_p99_ms=0.31,
        jitter_p50_ms=0.04,
        offset_interval_ns=(8.9994e12, 8.999401e12),
        warm_up_s=17.2,
    ),
    link=LinkView("serial:/dev/ttyACM0", expected_rate_hz=100.0),
    recording=RecordingView("rotdrift-trials/a.mcap", 1_500_000, None, 10**10),
    marks=(OperatorMark(31.0, "marker 1"),),
)
ALARM = replace(
    RUNNING,
    stream=StreamView(
        rate_hz=92.0,
        losses=LossReport(6100, 5978, 100, 20, 2),
        segments=2,
        segment_reason="the object was reset",
        reconnects=1,
        counters=CounterView(crc_errors=20),
    ),
    clock=replace(RUNNING.clock, skew_ppm=None),
    sensor=replace(RUNNING.sensor, saturated=True),
    motion=replace(RUNNING.motion, flags=("axis ambiguous",)),
    score=replace(RUNNING.score, window=WindowView(5.0, None)),
    warnings=("the link was lost and is open again; nothing came for 1.2 s",),
    alarms=(
        Alarm("reorientation", "cycle 11 moved it 8.1°: dropped, regrasped? (x: exclude)"),
        Alarm("losses", "2.0 % of the last samples are missing: check cable and distance"),
    ),
)
FLOOR = Alarm("floor", "θ̄ is below the sensor's floor of 0.95°, no drift at all looks the same; more cycles help")
CROWDED = replace(
    ALARM,
    alarms=(
        Alarm("link", "nothing has come for 3 s: check the object's battery and cable"),
        *ALARM.alarms,
        Alarm("axis", "it turns about no single axis: cycles may end at the wrong moment"),
        FLOOR,
    ),
    link=replace(ALARM.link, connected=False),
)
BELOW_FLOOR = replace(RUNNING, alarms=(FLOOR,), target=TargetView())
WINDOW = replace(
    RUNNING,
    target=TargetView(),
    score=replace(
        RUNNING.score,
        window=WindowView(24.0, 49.0),
        n_endpoints=6,
        origin_wxyz=ROWS[5].quat_wxyz,
        cycles=tuple(
            replace(row, excluded=MISSED, step_deg=2.5)
            if k == 8
            else replace(row, excluded=row.excluded if 5 < k < 11 else OUTSIDE)
            for k, row in enumerate(ROWS)
        ),
    ),
    stream=replace(RUNNING.stream, reconnects=1),
    warnings=(
        "serial:/dev/ttyACM0 is gone (device reports readiness to read but returned no data: unplugged, or in use)",
        "the link was lost and is open again; nothing came for 4.1 s",
    ),
    marks=(),
)
REFUSED = replace(
    RUNNING,
    score=replace(
        RUNNING.score,
        finished=True,
        theta_bar_deg=None,
        interval_deg=None,
        summary="no score: the motion does not repeat (confidence 0.11): it is not one rotation back and forth",
    ),
)
GUIDED = replace(RUNNING, guide=GuideView(3, 5, "let it turn", "10 of 20 cycles", 0.5))
FINISHED = replace(
    RUNNING,
    score=replace(
        RUNNING.score, finished=True, theta_bar_deg=0.8102, summary="live 0.812°, the result differs by -0.002°"
    ),
)
SECOND = replace(
    RUNNING,
    sensor=replace(RUNNING.sensor, name="ball"),
    score=replace(RUNNING.score, theta_bar_deg=2.5, cycles=ROWS[:5]),
    alarms=ALARM.alarms[1:],
)
BUS = replace(
    RUNNING,
    stream=replace(RUNNING.stream, counters=CounterView(misnumbered=256, unnumbered=3, wrong_lengths=1)),
    link=LinkView("can:socketcan:can0?node=3", expected_rate_hz=100.0),
)
REPLAYED = replace(RUNNING, title="rotdrift replay", recording=replace(RUNNING.recording, replayed=True))

SNAPSHOTS = {
    "nothing-80x24": ((NOTHING,), View(), 80, 24, False),
    "running-80x24": ((RUNNING,), View(), 80, 24, False),
    "running-80x24-colour": ((RUNNING,), View(), 80, 24, True),
    "running-80x24-light": ((RUNNING,), View(theme=Theme(light=True)), 80, 24, True),
    "running-100x30": ((RUNNING,), View(), 100, 30, False),
    "running-120x36": ((RUNNING,), View(), 120, 36, False),
    "running-200x60": ((RUNNING,), View(), 200, 60, False),
    "running-80x24-ascii": ((RUNNING,), View(theme=Theme(ascii_only=True)), 80, 24, False),
    "running-120x36-ascii": ((RUNNING,), View(theme=Theme(ascii_only=True)), 120, 36, False),
    "alarm-80x24": ((ALARM,), View(), 80, 24, False),
    "alarm-200x60": ((ALARM,), View(), 200, 60, False),
    "alarms-many-80x24": ((CROWDED,), View(), 80, 24, False),
    "below-floor-80x24": ((BELOW_FLOOR,), View(), 80, 24, False),
    "two-objects-80x24": ((RUNNING, SECOND), View(focus=1), 80, 24, False),
    "two-objects-120x36": ((RUNNING, SECOND), View(), 120, 36, False),
    "window-80x24": ((WINDOW,), View(), 80, 24, False),
    "guide-80x24": ((GUIDED,), View(), 80, 24, False),
    "prompt-80x24": ((RUNNING,), View(prompt="leave out cycle 11, because", typed="it slip"), 80, 24, False),
    "help-80x24": ((RUNNING,), View(help_open=True, paused=True), 80, 24, False),
    "finished-80x24": ((FINISHED,), View(), 80, 24, False),
    "replay-80x24": ((REPLAYED,), View(), 80, 24, False),
    "bus-80x24": ((BUS,), View(), 80, 24, False),
    "bus-120x36": ((BUS,), View(), 120, 36, False),
    "refused-80x24": ((REFUSED,), View(), 80, 24, False),
}
"""Name -> states, view, width, height, with colour."""


def draw(name):
    """Draw one snapshot as text."""
    states, view, width, height, colour = SNAPSHOTS[name]
    console = Console(
        file=io.StringIO(),
        width=width,
        height=height,
        force_terminal=colour,
        color_system="256" if colour else None,
        legacy_windows=False,
        _environ={},
    )
    for line in picture(states, view, width, height):
        console.print(line, no_wrap=True)
    lines = console.file.getvalue().split("\n")
    return "\n".join(line.rstrip() for line in lines).rstrip("\n") + "\n"


def main():
    FOLDER.mkdir(exist_ok=True)
    for name in SNAPSHOTS:
        (FOLDER / f"{name}.txt").write_text(draw(name), encoding="utf-8")
    sys.stdout.write(f"{len(SNAPSHOTS)} snapshots drawn in {FOLDER}; read their difference\n")


if __name__ == "__main__":
    main()
