"""Names and notes from devices cannot drive the terminal."""

import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from host.text import plain


def test_escape_sequences_and_line_breaks_do_not_survive():
    assert plain("\x1b[2J\x1b]0;owned\x07cube\r\nB\u202e") == "[2J]0;ownedcube B"


def test_long_texts_are_cut():
    assert plain("a" * 500, 10) == "aaaaaaaaa…"


@given(st.text(max_size=400))
def test_nothing_but_printable_characters_is_left(text):
    assert not [c for c in plain(text) if unicodedata.category(c) in {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}]
    assert len(plain(text)) <= 200
