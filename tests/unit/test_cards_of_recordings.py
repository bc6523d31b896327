"""Which card files belong to a recording, and how the object's own words fill and contradict them."""

from dataclasses import replace

import pytest

from firmware_protocol.packets import Info, InternalWeight, ObjectShape
from firmware_protocol.packets import ObjectCard as WireCard
from host.cards.definitions import Cards, parse_cards
from host.cards.files import card_of_object, find_cards, with_object
from host.errors import FileError

SAID = Info(
    device_id=0xA1,
    boot_id=1,
    name="cube \x1b[31m1",
    card=WireCard(
        shape=ObjectShape.CUBE,
        size_mm=(60.0, 60.0, 60.0),
        surface="smooth",
        mass_g=180.2,
        com_mm=(0.0, 0.0, 2.5),
        weights=(InternalWeight(1, 20.0),),
        mounting_q_body_sensor=(0.7071068, 0.0, 0.0, 0.7071068),
    ),
)


def test_the_nearer_file_wins(tmp_path):
    folder = tmp_path / "hand" / "cube"
    folder.mkdir(parents=True)
    (tmp_path / "hand" / "hand.toml").write_text("[hand]\nmodel = 'T42'\nfingers = 2")
    (folder / "hand.toml").write_text("[hand]\nmodel = 'T42b'")
    (folder / "roll.toml").write_text("[trial]\nmotion = 'roll'")
    (folder / "trial.toml").write_text("[trial]\nmotion = 'any'\noperator = 'ab'")
    (tmp_path / "given.toml").write_text("[trial]\noperator = 'cd'")
    cards = find_cards(folder / "roll.mcap", (tmp_path / "given.toml",))
    assert (cards.hand.model, cards.hand.fingers) == ("T42b", 2)
    assert (cards.trial.motion, cards.trial.operator) == ("roll", "cd")


def test_no_cards_is_no_error_but_a_missing_given_one_is(tmp_path):
    assert find_cards(tmp_path / "x.mcap") == Cards()
    with pytest.raises(FileError, match="no card"):
        find_cards(tmp_path / "x.mcap", (tmp_path / "y.toml",))


def test_the_object_fills_its_card():
    cards, notes = with_object(Cards(), SAID)
    assert cards.object.mass_g == pytest.approx(180.2)
    assert cards.object.dimensions is not None
    assert cards.object.dimensions.x_mm == 60.0
    assert cards.object.weights is not None
    assert cards.object.weights[0].slot == 1
    assert cards.object.name == "cube [31m1"
    assert len(notes) == 1
    assert "object.mass_g" in notes[0]


def test_a_mismatch_is_said_and_the_card_is_kept():
    cards, notes = with_object(
        parse_cards("[object]\nmass_g = 200\ntype = 'sphere'\nsurface = 'Smooth'\nweights = []"), SAID
    )
    assert cards.object.mass_g == 200
    said = "\n".join(notes)
    assert "object.mass_g: the card says 200, the object says 180.2" in said
    assert "object.type: the card says sphere, the object says cube" in said
    assert "object.weights: the card says none, the object says slot 1: 20 g" in said
    assert "object.surface" not in said


def test_the_same_values_with_float32_rounding_agree():
    text = """[object]
type = "cube"
dimensions = { x_mm = 60.01, y_mm = 60, z_mm = 60 }
mass_g = 180.21
com_mm = [0, 0, 2.5]
weights = [{ slot = 1, mass_g = 20.0 }]
mounting_q_body_sensor = [-0.7071068, 0, 0, -0.7071068]
"""
    _, notes = with_object(parse_cards(text), SAID)
    assert not [note for note in notes if "the card says" in note]


def test_what_the_object_does_not_know_stays_out():
    empty = card_of_object(replace(SAID, card=WireCard(), name=""))
    assert empty.type is None
    assert empty.dimensions is None
    assert empty.mass_g is None
    assert empty.com_mm is None
    assert empty.weights is None
    assert empty.mounting_q_body_sensor is None
    assert with_object(Cards(), None) == (Cards(), ())
