"""A text that does everything to a terminal that a text can do, and what must not be left of it."""

import re
import unicodedata

HOSTILE = (
    "\x1b]0;OWNED\x07\x1b[2J\x1b[31m\x9b31m\x90q\x9c\x08\x7f\x85\u202eevil\u2066\u200f\u200b\ufeff\u2028\u2029"
    "\U000e0041\ue000[bold red]x[/]\r\nFAKE: done\tz"
)
"""Sequences of ESC and of C1, a bell, DEL, what reorders or hides text, markup of rich, and a line of its own."""
NAME = HOSTILE.replace("/", "|")
"""The same as a name of a file: on POSIX whatever has no slash is one."""
NOT_UTF8 = NAME + "\udcff"
"""A name that is not UTF-8, as Python has it."""
ALLOWED = "\n\t"
UNPRINTABLE = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
OUR_STYLES = re.compile(r"\x1b\[[0-9;]*m")


def faults(text):
    """What a terminal would act on, and lines that only look like ours."""
    found = sorted({f"U+{ord(c):04X}" for c in text if c not in ALLOWED and unicodedata.category(c) in UNPRINTABLE})
    return found + [line for line in text.split("\n") if line.startswith("FAKE")]


def check_clean(*texts):
    for text in texts:
        assert faults(text) == [], ascii(text)
