"""Cards: what may stand in them, what is refused and how it is said, and what a submission lacks."""

import json
from pathlib import Path

import jsonschema
import pytest

from host.cards.definitions import (
    REQUIRED,
    TABLES,
    Dimensions,
    ObjectType,
    cards_schema,
    dump_cards,
    load_cards,
    merged,
    missing_fields,
    parse_cards,
)
from host.errors import FileError

FULL = """
[object]
type = "cube"
dimensions = { x_mm = 60, y_mm = 60, z_mm = 60.5 }
surface = "smooth"
material = "PLA"
mass_g = 180.2
mass_uncertainty_g = 0.5
com_mm = [0.0, 0, -2.5]
com_uncertainty_mm = 0.5
weights = [{ slot = 1, mass_g = 20.0 }, { slot = 4, mass_g = 20 }]
mounting_q_body_sensor = [0.7071068, 0, 0, 0.7071068]
id = "00000000000000a1"

[hand]
model = "T42"
maker = "lab"
fingers = 2
aperture_mm = 90
aperture_measured = "calliper, open"
control_mode = "open loop"
control_rate_hz = 50

[trial]
motion = "roll"
axis = "object x"
protocol = "P19-0838.3"
repeats = 20
operator = "ab"
comments = "first line\\nsecond line"
"""


def test_a_full_card_lacks_nothing_and_comes_back_as_written():
    cards = parse_cards(FULL)
    assert missing_fields(cards) == ()
    assert cards.object.type is ObjectType.CUBE
    assert cards.object.com_mm == (0.0, 0.0, -2.5)
    assert cards.trial.comments == "first line\nsecond line"
    assert parse_cards(dump_cards(cards)) == cards


def test_an_empty_card_lacks_every_required_field_and_invents_none():
    cards = parse_cards("")
    assert missing_fields(cards) == tuple(REQUIRED)
    assert dump_cards(cards) == ""


def test_no_weights_is_an_answer_but_no_answer_is_not():
    assert "object.weights" not in missing_fields(parse_cards("[object]\nweights = []"))
    assert "object.weights" in missing_fields(parse_cards("[object]\nmass_g = 10"))
    assert parse_cards(dump_cards(parse_cards("[object]\nweights = []"))).object.weights == ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[object]\nmass_g = -1", "object.mass_g"),
        ("[object]\nmass_g = nan", "object.mass_g"),
        ("[object]\ncom_mm = [0, inf, 0]", "object.com_mm"),
        ("[object]\ncom_mm = [0, 0]", "length 3"),
        ("[object]\nmass_g = 'heavy'", "object.mass_g: expected a number, got str"),
        ("[object]\ntype = 'pyramid'", "object.type: 'pyramid' is not one of cube, cylinder, sphere, other"),
        ("[trial]\nprotocol = '3'", "trial.protocol: '3' is not one of P19-0838.2, P19-0838.3, P19-0838.4"),
        ("[object]\ntype = 'pyramid'", "pyramid"),
        ("[object]\nmas_g = 10", "unknown field mas_g"),
        ("[objekt]\nmass_g = 10", "unknown field objekt"),
        ("[trial]\nprotocol = 'P19'", "P19"),
        ("[object]\ntype='sphere'\ndimensions={x_mm=1, y_mm=1, z_mm=1}", "diameter_mm"),
        ("[object]\nmounting_q_body_sensor = [1, 0, 0, 1]", "norm 1.4142"),
        ("[object]\nmass_g = 10\nweights=[{slot=1, mass_g=20}]", "20 g together"),
        ("[object]\nweights=[{slot=1, mass_g=2}, {slot=1, mass_g=3}]", "same slot"),
        ("[object\n", "not TOML"),
        (f"{'a.' * 2000}a = 1", "nested too deeply"),
        ("[hand]\nfingers = 2.5", "hand.fingers"),
    ],
)
def test_what_is_wrong_is_named(text, said):
    with pytest.raises(FileError) as caught:
        parse_cards(text)
    assert said in str(caught.value)
    assert "Traceback" not in str(caught.value)


def test_control_characters_are_taken_out_of_every_text():
    cards = parse_cards('[hand]\nmodel = "T\\u001b[31m42"\n[trial]\ncomments = "a\\u0007b\\n\\u202ec"')
    assert cards.hand.model == "T[31m42"
    assert cards.trial.comments == "ab\nc"


def test_merging_takes_the_first_that_knows():
    first = parse_cards("[object]\nmass_g = 10")
    second = parse_cards("[object]\nmass_g = 20\nsurface = 'rough'\n[hand]\nmodel = 'T42'")
    both = merged(first, second)
    assert (both.object.mass_g, both.object.surface, both.hand.model) == (10, "rough", "T42")


def test_unreadable_files_are_said_in_one_sentence(tmp_path):
    with pytest.raises(FileError, match="there is no file"):
        load_cards(tmp_path / "none.toml")
    (tmp_path / "latin.toml").write_bytes(b"[hand]\nmodel = 'M\xfcller'")
    with pytest.raises(FileError, match="UTF-8"):
        load_cards(tmp_path / "latin.toml")
    (tmp_path / "big.toml").write_bytes(b"#" * 1_000_001)
    with pytest.raises(FileError, match="larger"):
        load_cards(tmp_path / "big.toml")


def test_every_field_has_a_description_and_required_fields_exist():
    schema = cards_schema()
    for table, card in TABLES.items():
        for name, field in schema["$defs"][card.__name__]["properties"].items():
            assert "description" in field, f"{table}.{name}"
    for field in REQUIRED:
        table, name = field.split(".")
        assert name in TABLES[table].__struct_fields__


def test_the_published_schema_is_the_code_s_own_and_judges_as_the_code_does():
    published = json.loads((Path(__file__).parents[2] / "docs" / "cards.schema.json").read_text("utf-8"))
    assert published == cards_schema(), "renew it: rotdrift init --schema > docs/cards.schema.json"
    validator = jsonschema.Draft202012Validator(published)
    import tomllib

    assert validator.is_valid(tomllib.loads(FULL))
    assert not validator.is_valid(tomllib.loads("[object]\nmass_g = -1"))
    assert not validator.is_valid(tomllib.loads("[object]\nmas_g = 1"))


def test_contradictions_of_an_untyped_object_are_not_guessed():
    cards = parse_cards("[object]\ndimensions = { diameter_mm = 3 }")
    assert cards.object.dimensions == Dimensions(diameter_mm=3.0)
