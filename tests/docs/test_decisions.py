"""Decisions (ADRs) are numbered, dated and short; pages that the program names exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DECISIONS = sorted((ROOT / "docs" / "adr").glob("*.md"))
SOURCES = [
    path
    for room in ("analysis", "emulator", "firmware_protocol", "host")
    for path in sorted((ROOT / room).rglob("*.py"))
]


def test_decisions_are_numbered_without_a_hole():
    assert [path.name[:5] for path in DECISIONS] == [f"{number:04}-" for number in range(1, len(DECISIONS) + 1)]


@pytest.mark.parametrize("path", DECISIONS, ids=lambda path: path.stem)
def test_a_decision_says_context_decision_and_consequences(path):
    text = path.read_text(encoding="utf-8")
    assert re.match(
        rf"# ADR {path.name[:4]}: \S.*\n\nStatus: (accepted|superseded by ADR \d{{4}}) \(\d{{4}}-\d\d-\d\d\)\n", text
    )
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == ["Context", "Decision", "Consequences"]
    assert len(text.splitlines()) <= 40


def test_pages_that_messages_and_docstrings_name_exist():
    named = {}
    for path in SOURCES:
        for page in re.findall(r"\bdocs/[\w./-]*\w", path.read_text(encoding="utf-8")):
            named.setdefault(page, path.name)
    assert len(named) > 3
    assert {page: name for page, name in named.items() if not (ROOT / page).exists()} == {}
