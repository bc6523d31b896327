"""The dashboard as it is drawn, for the states that matter. Regenerate: ``python -m tests.unit.dashboard_states``."""

import re
from dataclasses import replace

import pytest
from rich.cells import cell_len

from host.screen.dashboard.picture import Theme, View, picture
from tests.unit.dashboard_states import ALARM, FOLDER, GUIDED, NOTHING, RUNNING, SECOND, SNAPSHOTS, draw


@pytest.mark.parametrize("name", sorted(SNAPSHOTS))
def test_the_picture_is_as_agreed(name):
    agreed = (FOLDER / f"{name}.txt").read_text(encoding="utf-8")
    assert draw(name) == agreed, "if this is meant: python -m tests.unit.dashboard_states, and read the difference"


def test_there_are_no_snapshots_of_nothing():
    assert {path.stem for path in FOLDER.glob("*.txt")} == set(SNAPSHOTS)


@pytest.mark.parametrize("theme", [Theme(), Theme(ascii_only=True)], ids=["unicode", "ascii"])
@pytest.mark.parametrize("size", [(80, 24), (60, 16), (109, 28), (110, 28), (111, 27), (200, 60), (300, 90), (40, 10)])
@pytest.mark.parametrize("states", [(NOTHING,), (RUNNING,), (ALARM,), (GUIDED,), (RUNNING, SECOND) * 9])
def test_every_line_has_the_width_of_the_terminal(states, size, theme):
    lines = picture(states, View(theme=theme, focus=1), *size)
    assert len(lines) == size[1]
    assert {cell_len(line.plain) for line in lines} == {size[0]}
    if theme.ascii_only:
        assert all(line.plain.isascii() for line in lines)


@pytest.mark.parametrize("height", range(26, 34))
def test_a_wide_terminal_with_little_height_left_has_a_picture_too(height):
    states = (replace(ALARM, guide=GUIDED.guide), *[SECOND] * 15)
    for theme in (Theme(), Theme(ascii_only=True)):
        lines = picture(states, View(theme=theme), 100, height)
        assert [cell_len(line.plain) for line in lines] == [100] * height


def test_colour_is_never_the_only_carrier():
    def bare(name):
        return re.sub(r"\x1b\[[0-9;]*m", "", draw(name))

    assert [line.rstrip() for line in bare("running-80x24-colour").splitlines()] == draw("running-80x24").splitlines()
    assert draw("running-80x24-colour") != draw("running-80x24-light")
    assert "\x1b" not in draw("alarm-80x24")


def test_more_cycles_than_fit_show_the_newest():
    state = RUNNING.with_cycles(tuple(replace(RUNNING.score.cycles[-1], number=k) for k in range(100, 300)))
    text = "\n".join(line.plain for line in picture((state,), View(), 80, 24))
    assert "   299 " in text
    assert "   200 " not in text


def test_long_names_keep_their_end():
    state = replace(
        RUNNING,
        link=replace(RUNNING.link, name="can:udp_multicast:239.74.163.77?bitrate=500000&node=3"),
        recording=replace(RUNNING.recording, path="/home/somebody/" + "folder/" * 12 + "cube_roll.mcap"),
    )
    lines = [line.plain for line in picture((state,), View(), 80, 24)]
    link, recording = (next(line for line in lines if line[2:].startswith(name)) for name in ("link", "recording"))
    assert link.rstrip(" │").endswith("&node=3")
    assert recording.rstrip(" │").endswith("/cube_roll.mcap")


def test_what_is_remembered_of_a_drawing_follows_its_state():
    """The same cycles drawn again are taken from memory; another size, theme or origin is not."""
    first = picture((RUNNING,), View(), 120, 36)
    changed = replace(RUNNING, score=replace(RUNNING.score, origin_wxyz=RUNNING.score.cycles[5].quat_wxyz))
    assert [line.plain for line in picture((changed,), View(), 120, 36)] != [line.plain for line in first]
    for size in ((120, 36), (119, 36), (120, 36), (80, 24)):
        for theme in (Theme(), Theme(ascii_only=True), Theme(light=True)):
            fresh = RUNNING.with_cycles((*RUNNING.score.cycles,))
            assert fresh.score.cycles is not RUNNING.score.cycles
            again = picture((RUNNING,), View(theme=theme), *size)
            assert again == picture((fresh,), View(theme=theme), *size)
