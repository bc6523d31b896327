"""Results that were stored before are read by today's type, strictly, and are written again the same."""

import json
from pathlib import Path

import pytest
from msgspec import structs

from analysis.scoring.result import Result, parse_result, result_text, schema_text
from analysis.scoring.trial import score_series
from tests.golden_results import FOLDER, stored
from tests.simulated_motion import simulate

SCHEMA = Path(__file__).parents[2] / "docs" / "result.schema.json"
NAMES = sorted(path.name.removesuffix(".json.gz") for path in FOLDER.glob("*.json.gz"))


@pytest.mark.parametrize("name", NAMES)
def test_a_stored_result_is_read_and_written_again_the_same(name):
    found = [entry["result"] for entry in stored(name).values() if isinstance(entry, dict) and entry.get("result")]
    assert found
    for values in found:
        text = json.dumps(values)
        result = parse_result(text.encode())
        assert json.dumps(result.to_json()) == text  # the order of the keys as well
        assert parse_result(result_text(result).encode()) == result


@pytest.fixture(scope="module")
def values():
    return score_series(simulate(cycles=6).series).to_json()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"theta_bar_deg": "0.8"}, r"Expected `float \| null`, got `str` - at `\$.theta_bar_deg`"),
        ({"valid": 1}, r"Expected `bool`, got `int` - at `\$.valid`"),
        ({"theta": 0.8}, "unknown field `theta`"),
        ({"window": {"kind": "automatic"}}, "missing required field `from_s`"),
    ],
)
def test_what_is_not_a_result_is_refused_and_named(values, change, message):
    with pytest.raises(ValueError, match=message):
        parse_result(json.dumps(values | change).encode())
    with pytest.raises(ValueError, match="missing required field `period_s`"):
        parse_result(json.dumps({key: value for key, value in values.items() if key != "period_s"}).encode())


def test_a_result_cannot_be_changed_and_replacing_a_field_makes_another(values):
    result = parse_result(json.dumps(values).encode())
    with pytest.raises(AttributeError):
        result.valid = False
    assert structs.replace(result, valid=False) != result


def test_the_schema_is_that_of_the_type():
    published = SCHEMA.read_text("utf-8")
    assert published == schema_text(Result, "rotdrift result"), "renew it: schema_text in analysis.scoring.result"
