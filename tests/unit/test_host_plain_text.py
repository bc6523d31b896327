"""Names and notes from devices cannot drive the terminal."""

import io
import json
import unicodedata
from contextlib import redirect_stdout

from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table
from rich.text import Text

from host.output.drawings import PrintableConsole
from host.output.lines import ask, write_json
from host.output.streams import installed
from host.screen.dashboard.theme import Theme
from host.screen.painter import Painter
from host.text import one_line, plain, printable, printable_json
from tests.hostile_text import HOSTILE, NOT_UTF8, OUR_STYLES, check_clean, faults


def test_escape_sequences_and_line_breaks_do_not_survive():
    assert plain("\x1b[2J\x1b]0;owned\x07cube\r\nB\u202e") == "[2J]0;ownedcube B"


def test_long_texts_are_cut():
    assert plain("a" * 500, 10) == "aaaaaaaaa…"


@given(st.text(max_size=400))
def test_nothing_but_printable_characters_is_left(text):
    assert not [c for c in plain(text) if unicodedata.category(c) in {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}]
    assert len(plain(text)) <= 200


@given(st.text(max_size=400))
def test_json_keeps_its_values_and_loses_what_a_terminal_acts_on(text):
    document = json.dumps({text: [text, "θ̄"]}, indent=2, ensure_ascii=False)
    shown = printable_json(document)
    assert json.loads(shown) == {text: [text, "θ̄"]}
    assert faults(shown) == []
    assert "θ̄" in shown


def test_json_passes_the_streams_whole():
    out = io.StringIO()
    with redirect_stdout(out), installed():
        write_json(json.dumps({HOSTILE: NOT_UTF8}, ensure_ascii=False))
    assert json.loads(out.getvalue()) == {HOSTILE: NOT_UTF8}
    check_clean(out.getvalue())


@given(st.text(max_size=400))
def test_a_line_is_one_line_and_a_text_keeps_its_own(text):
    assert not [c for c in one_line(text) if c in "\n\t" or faults(c)]
    assert faults(printable(text.replace("FAKE", ""), "\n\t")) == []


def test_a_prompt_and_a_picture_are_cleaned_as_well(monkeypatch):
    shown = []
    monkeypatch.setattr("builtins.input", lambda prompt: shown.append(prompt) or "answer")
    assert ask(f"name [{HOSTILE}]: ") == "answer"
    painter = Painter(None, Theme(color="truecolor"))
    coded = painter._codes(Text.assemble((HOSTILE, "bold red")))
    assert OUR_STYLES.search(coded)
    check_clean(*shown, OUR_STYLES.sub("", coded).replace("\n", " "))


def test_a_console_colours_its_own_texts_only():
    out = io.StringIO()
    console = PrintableConsole(file=out, force_terminal=True, color_system="truecolor", width=60)
    table = Table(title=HOSTILE)
    table.add_column(HOSTILE)
    table.add_row(Text(HOSTILE, style="red"))
    console.print(table, Text(HOSTILE), HOSTILE.replace("[", "("))
    assert "\x1b[31m" in out.getvalue()
    left = OUR_STYLES.sub("", out.getvalue())
    assert [fault for fault in faults(left) if fault.startswith("U+")] == []
