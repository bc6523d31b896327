"""``rotdrift init``: questions, defaults, validation, no terminal, no overwriting."""

import argparse
import io
import json
import sys

import pytest

from host.cards.definitions import Cards, load_cards, missing_fields, parse_cards
from host.cards.questions import ask_for_cards, template
from host.commands import init
from host.errors import FileError, UsageError


class Typist:
    """Answers questions by the name of their field; leaves the rest out."""

    def __init__(self, **answers):
        self.answers = {name: list(given) if isinstance(given, list) else [given] for name, given in answers.items()}
        self.prompts: list[str] = []
        self.said: list[str] = []

    def ask(self, prompt):
        self.prompts.append(prompt)
        name = prompt.split()[0].rstrip("*")
        answers = self.answers.get(name, [])
        return answers.pop(0) if answers else ""


def fill(known=None, tables=("object", "hand", "trial"), **answers):
    typist = Typist(**answers)
    return ask_for_cards(known or Cards(), tables, typist.ask, typist.said.append), typist


def test_answers_become_a_complete_card():
    cards, typist = fill(
        type="cylinder",
        dimensions="60 x 80",
        surface="smooth",
        mass_g="180.5",
        com_mm="(0, 0, 2.5) mm",
        weights="1:20, 4:20.5",
        model="T42",
        aperture_mm="90",
        fingers="2",
        control_mode="open loop",
        motion="roll",
        protocol="P19-0838.3",
        comments="fine",
    )
    assert missing_fields(cards) == ()
    assert cards.object.dimensions is not None
    assert (cards.object.dimensions.diameter_mm, cards.object.dimensions.length_mm) == (60, 80)
    assert cards.object.weights is not None
    assert [w.mass_g for w in cards.object.weights] == [20, 20.5]
    assert cards.hand.fingers == 2
    assert any("mass_g* (total mass" in prompt for prompt in typist.prompts)


def test_wrong_answers_are_explained_and_asked_again():
    cards, typist = fill(
        tables=("object",),
        type=["pyramid", "cube"],
        dimensions=["60 60", "60 60 sixty", "60x60x60 mm"],
        mass_g=["heavy", "-3", "nan", "180 kg", "180 g"],
        weights=["twenty", "1:20 kg", "1:200", "1:20 g"],
    )
    said = "\n".join(typist.said)
    assert cards.object.mass_g == 180
    assert cards.object.weights is not None
    assert len(cards.object.weights) == 1
    for sentence in ("pyramid", "give 3 numbers", "'sixty' is not a number", "'heavy' is not a number", "slot:grams"):
        assert sentence in said
    assert "200 g together" in said


def test_enter_keeps_the_default_and_a_dash_takes_it_out():
    known = parse_cards("[hand]\nmodel = 'T42'\nfingers = 2\naperture_mm = 90.0")
    cards, typist = fill(known, ("hand",), fingers="-", aperture_mm="95")
    assert (cards.hand.model, cards.hand.fingers, cards.hand.aperture_mm) == ("T42", None, 95)
    assert any("[T42]" in prompt for prompt in typist.prompts)


def test_another_type_forgets_a_size_that_no_longer_fits():
    known = parse_cards("[object]\ntype = 'cube'\ndimensions = { x_mm = 1, y_mm = 2, z_mm = 3 }")
    cards, _ = fill(known, ("object",), type="sphere", dimensions="70")
    assert cards.object.dimensions is not None
    assert cards.object.dimensions.diameter_mm == 70
    cards, _ = fill(known, ("object",), type="sphere")
    assert cards.object.dimensions is None


def test_the_template_is_a_card_once_its_comments_are_taken():
    text = template()
    assert parse_cards(text) == Cards()
    uncommented = "\n".join(
        line[1:] if line.startswith("#") and line[1:2] != " " else line for line in text.split("\n")
    )
    assert missing_fields(parse_cards(uncommented)) == ()


def run(*arguments):
    parser = argparse.ArgumentParser()
    init.add_parser(parser.add_subparsers())
    return init.run(parser.parse_args(["init", *arguments]))


def test_without_a_terminal_it_never_waits(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    with pytest.raises(UsageError, match="--from"):
        run(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_from_a_file_it_writes_three_cards_and_says_what_lacks(tmp_path, capsys):
    source = tmp_path / "all.toml"
    source.write_text("[object]\nmass_g = 10\n[hand]\nmodel = 'T42'\n")
    assert run(str(tmp_path / "out"), "--from", str(source)) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["hand.toml", "object.toml", "trial.toml"]
    assert load_cards(tmp_path / "out" / "object.toml").object.mass_g == 10
    assert load_cards(tmp_path / "out" / "trial.toml") == Cards()
    assert "also needs: object.type" in capsys.readouterr().out
    with pytest.raises(FileError, match="exists already"):
        run(str(tmp_path / "out"), "--from", str(source))
    assert run(str(tmp_path / "out"), "--from", str(source), "--card", "hand", "--force") == 0


def test_the_schema_is_printed(capsys):
    assert run("--schema") == 0
    assert json.loads(capsys.readouterr().out)["title"] == "rotdrift cards"
