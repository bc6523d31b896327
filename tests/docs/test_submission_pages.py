"""The pages about cards and submissions agree with the code."""

import re
from pathlib import Path

from host.cards.definitions import REQUIRED, TABLES, missing_fields, parse_cards
from host.submission.manifest import TrialEntry

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_of_cards_names_every_field_and_marks_the_required_ones():
    page = (DOCS / "cards.md").read_text("utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ") and "`" in line]
    found: dict[str, set[str]] = {}
    table = ""
    for row in rows:
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        if match := re.match(r"`\[(\w+)\]`", cells[0]):
            table = match[1]
        for name, star in re.findall(r"`(\w+)`( \*)?", cells[1]):
            found.setdefault(table, set()).add(name)
            assert (f"{table}.{name}" in REQUIRED) == bool(star), f"{table}.{name}"
    assert found == {table: set(card.__struct_fields__) for table, card in TABLES.items()}


def test_the_example_card_is_a_complete_one():
    (example,) = re.findall(r"```toml\n(.*?)```", (DOCS / "cards.md").read_text("utf-8"), re.DOTALL)
    assert missing_fields(parse_cards(example)) == ()


def test_every_bullet_of_the_benchmark_card_has_its_place():
    page = (DOCS / "submission.md").read_text("utf-8")
    for bullet in (
        "type, size, surface",
        "mass and centre of mass",
        "hand model, aperture",
        "θ̄",
        "point clouds",
        "comments",
    ):
        assert any(bullet in line for line in page.splitlines() if line.startswith("|")), bullet
    for name in re.findall(r"`trials\[\]\.(\w+)", page):
        assert name in TrialEntry.__struct_fields__
