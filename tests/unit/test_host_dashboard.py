"""The screen: fits, reads without colour, shows hostile names as text."""

import io
from dataclasses import replace

import pytest
from rich.cells import cell_len
from rich.console import Console

from host.losses.ledger import LossReport
from host.screen.choice import _shows_ascii_only, open_screen
from host.screen.dashboard.canvas import big_text
from host.screen.dashboard.picture import Theme, View, picture
from host.screen.dashboard.score_panel import verdicts
from host.screen.screens import LineScreen, QuietScreen
from host.trial.state import (
    Alarm,
    CycleRow,
    GuideView,
    LinkView,
    MotionView,
    RecordingView,
    ScoreView,
    SensorView,
    StreamView,
    TargetView,
    TrialState,
)


def drawn(state, width=80, height=24, **options):
    console = Console(file=io.StringIO(), width=width, height=height, force_terminal=True, **options)
    for line in picture((state,), View(), width, height):
        console.print(line, no_wrap=True)
    return console.file.getvalue()


def plain(state, width=80, height=24):
    return drawn(state, width, height, no_color=True, color_system=None)


def rows(n):
    return tuple(
        CycleRow(k, 4.0 * k + 6, 4.0 if k else None, 0.8 if k else None, None, 0.8 if k else None) for k in range(n)
    )


RUNNING = TrialState(
    title="rotdrift capture",
    elapsed_s=61.0,
    target=TargetView(cycles=20),
    score=ScoreView(n_endpoints=12, cycles=rows(12), theta_bar_deg=0.8125, interval_deg=(0.71, 0.92)),
    motion=MotionView("running", True, 4.0, 40.0),
    sensor=SensorView(
        name="[red]cube[/red]", still=False, temperature_c=31.25, battery_v=3.9, orientation_wxyz=(1, 0, 0, 0)
    ),
    stream=StreamView(rate_hz=99.9, losses=LossReport(100, 98, 2)),
    link=LinkView("serial:/dev/ttyACM0", expected_rate_hz=100.0),
    recording=RecordingView("a.mcap", 1_500_000, None, 10**10),
)


@pytest.mark.parametrize(("width", "height"), [(80, 24), (200, 60), (80, 18)])
@pytest.mark.parametrize("state", [TrialState(), RUNNING], ids=["nothing yet", "running"])
def test_it_fits_the_terminal(state, width, height):
    lines = plain(state, width, height).rstrip("\n").split("\n")
    assert len(lines) <= height
    assert max(map(cell_len, lines)) <= width


def test_what_matters_is_there_without_colour():
    text = plain(RUNNING)
    for part in (
        "0.71° to 0.92°",
        "11 of 20 cycles · 01:01",
        "[red]cube[/red]",
        "99.9 Hz of 100",
        "2 lost",
        "2.00 %",
        "1.5 MB",
        "31 °C",
        "0.800",
        "4.000 s",
    ):
        assert part in text, part
    assert all(line in text for line in big_text("0.81°"))
    assert "\x1b[3" not in text


def test_the_newest_cycles_are_kept_when_there_is_little_room():
    text = plain(RUNNING)
    assert " 11 " in text
    assert " start " not in text
    assert " start " in plain(RUNNING, 80, 40)


def test_waiting_and_finished_are_told_apart():
    assert "no data yet" in plain(TrialState())
    assert "so far" in plain(RUNNING)
    finished = TrialState(score=ScoreView(theta_bar_deg=1.0, finished=True))
    assert "the result" in plain(finished)


def test_troubles_are_words_not_only_colours():
    text = plain(
        TrialState(
            link=LinkView(connected=False, overflow_chunks=3),
            stream=StreamView(segments=3, reconnects=1),
            recording=RecordingView("a", 0, "the disk is full; 1.0 MB are kept in memory until it can be written"),
            sensor=SensorView(still=True, saturated=True),
            warnings=("something \x07happened",),
        )
    )
    for part in ("DISCONNECTED", "3 chunks", "1 reconnect", "disk is full", "SATURATED", "! something"):
        assert part in text, part


NO_TARGET = TargetView()


def glance(target=NO_TARGET, score=None, **changes):
    """The verdicts of a trial that is well, but for some changes."""
    sensor = replace(RUNNING.sensor, floor_deg=0.05)
    state = replace(RUNNING, sensor=sensor, target=target, score=replace(RUNNING.score, **(score or {})))
    return [words for words, _ in verdicts(replace(state, **changes))]


def test_a_glance_tells_connected_cycles_trust_and_enough():
    assert glance() == ["✓ connected", "✓ cycles", "✓ above the floor", "✓ enough to score"]
    assert [words for words, _ in verdicts(TrialState())] == ["… no data yet", "… needs 4 more cycles"]
    motion, sensor = RUNNING.motion, RUNNING.sensor
    assert glance(link=replace(RUNNING.link, connected=False))[0] == "! DISCONNECTED"
    assert glance(stream=replace(RUNNING.stream, silent_s=3.2))[0] == "! silent for 3 s"
    assert glance(alarms=(Alarm("no cycles", "..."),))[1] == "! no cycles found"
    nothing = {"cycles": (), "n_endpoints": 0, "theta_bar_deg": None}
    assert glance(score=nothing)[1:] == ["… no cycles yet", "… needs 4 more cycles"]
    assert glance(motion=replace(motion, flags=("pause",)))[1] == "… the hand rests"
    assert glance(sensor=sensor)[2] == "! floor unknown"
    assert glance(alarms=(Alarm("floor", "..."),))[2] == "! below the floor"
    assert glance(alarms=(Alarm("floor", "..."), Alarm("swing", "...")))[2] == "! see the alarm"
    assert glance(TargetView(cycles=12))[3] == "… 1 cycle to go"
    assert glance(score={"n_endpoints": 4})[3] == "… needs 1 more cycle"
    narrow = TargetView(half_width_deg=0.2)
    assert glance(narrow, {"half_width_deg": 0.3, "more_cycles": 5})[3] == "… needs 5 more for ±0.2°"
    assert glance(narrow, {"half_width_deg": 0.3, "more_cycles": None})[3] == "! ±0.2° is out of reach"
    assert glance(narrow, {"half_width_deg": 0.2})[3] == "✓ ±0.2° reached"
    assert glance(guide=GuideView(3, 5, "let it turn", ""))[2:] == ["✓ above the floor"]
    assert glance(recording=replace(RUNNING.recording, replayed=True))[0] == "✓ cycles"
    assert glance(score={"finished": True}) == []


def test_where_there_is_no_room_for_all_verdicts_trust_is_left_out():
    score = replace(RUNNING.score, half_width_deg=0.3, more_cycles=5)
    state = replace(RUNNING, target=TargetView(20, half_width_deg=0.2), score=score)
    assert "connected ─ ✓ cycles ─ ! floor unknown ─ … needs 5 more for ±0.2° ─" in plain(state, 80)
    assert "connected ─ ✓ cycles ─ … needs 5 more for ±0.2° ─" in plain(state, 70)
    assert "connected ─ … needs 5 more for ±0.2° ─" in plain(state, 50)


@pytest.mark.parametrize("ascii_only", [False, True])
def test_a_long_note_shows_where_it_is_typed(ascii_only):
    view = View(Theme(ascii_only), prompt="note", typed="the finger " * 12 + "日本 slipped")
    line = picture((RUNNING,), view, 80, 24)[-1].plain.rstrip()
    assert line.endswith("slipped_  (Enter, Esc)")
    assert cell_len(line) <= 80


def test_when_all_objects_are_finished_any_key_ends():
    finished = replace(RUNNING.score, finished=True)
    guided = replace(RUNNING, guide=GuideView(5, 5, "done", ""), score=finished)
    ends = [picture((first, guided), View(), 80, 24)[-1].plain.rstrip() for first in (RUNNING, guided)]
    assert "q finish" in ends[0]
    assert ends[1] == "finished  any key ends"


def test_at_rest_no_axis_is_ambiguous():
    resting = replace(RUNNING, motion=replace(RUNNING.motion, flags=("axis ambiguous",), turn_rate_dps=0.2))
    assert "ambiguous" not in plain(resting)
    assert "ambiguous" in plain(replace(resting, motion=replace(resting.motion, turn_rate_dps=20.0)))


def test_large_figures_know_their_limits():
    assert len({len(line) for line in big_text("-12.90°")}) == 1
    with pytest.raises(ValueError, match="no large figure"):
        big_text("x")


def test_lines_say_each_cycle_once():
    stream = io.StringIO()
    screen = LineScreen(stream)
    screen.start()
    for row in rows(3):
        screen.cycle(row)
    screen.update(RUNNING)
    screen.report("the \x1b[2Jend")
    screen.stop()
    lines = stream.getvalue().splitlines()
    assert len(lines) == 4
    assert lines[0].startswith("start")
    assert "period  4.000 s  step   0.800°  θ̄   0.800°" in lines[2]
    assert lines[3] == "the [2Jend"


def test_lines_tell_of_alarms_once_and_of_which_object():
    stream = io.StringIO()
    screen = LineScreen(stream)
    up = replace(RUNNING, alarms=(Alarm("link", "nothing has come for 3 s"),))
    for state in (RUNNING, up, up, RUNNING, up):
        screen.update(state)
    screen.update(up, 1)
    screen.cycle(rows(1)[0], 1)
    lines = stream.getvalue().splitlines()
    assert lines[:2] == ["ALARM link: nothing has come for 3 s"] * 2
    assert lines[2] == "object 2  ALARM link: nothing has come for 3 s"
    assert lines[3].startswith("object 2  start")


def test_a_reader_of_lines_that_went_away_does_not_end_the_capture():
    stream = io.StringIO()
    screen = LineScreen(stream)
    stream.close()
    screen.report("nobody hears this")
    screen.report("nor this")


@pytest.mark.parametrize(
    ("environment", "ascii_only"),
    [
        ({}, False),
        ({"LANG": "C.UTF-8"}, False),
        ({"LANG": "C"}, True),
        ({"LANG": "C", "LC_CTYPE": "C.UTF-8"}, True),  # as Python leaves it
        ({"LANG": "C", "LC_CTYPE": "de_DE.UTF-8"}, False),
        ({"LANG": "de_DE.UTF-8", "LC_ALL": "POSIX"}, True),
        ({"LANG": "C", "PYTHONUTF8": "1"}, False),
        ({"LANG": "de_DE.UTF-8", "TERM": "linux"}, True),
    ],
)
def test_the_c_locale_and_the_bare_console_have_ascii_only(environment, ascii_only):
    assert _shows_ascii_only(environment) == ascii_only


def test_without_a_terminal_there_are_lines_and_with_json_they_go_to_stderr(capsys):
    stream = io.StringIO()
    open_screen(False, stream).report("here")
    assert stream.getvalue() == "here\n"
    open_screen(True, stream).report("there")
    assert capsys.readouterr().err == "there\n"
    QuietScreen().report("nowhere")
