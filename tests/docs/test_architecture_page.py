"""docs/architecture.md and its drawing are what the code says: layers, docstrings, and the road of a sample."""

import importlib
import importlib.util
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
_spec = importlib.util.spec_from_file_location("architecture_road", ROOT / "docs" / "architecture_road.py")
road = importlib.util.module_from_spec(_spec)
sys.modules[_spec.name] = road  # dataclasses look their module up
_spec.loader.exec_module(road)
AGAIN = "run: python docs/architecture_road.py"


def test_the_page_is_made_from_the_code():
    text = road.PAGE.read_text(encoding="utf-8")
    assert road.filled(text) == text, AGAIN


def test_the_drawing_is_made_from_the_contracts():
    assert road.drawing() == road.PICTURE.read_text(encoding="utf-8"), AGAIN


@pytest.mark.parametrize("stage", road.ROAD, ids=lambda stage: stage.module)
def test_every_stop_of_the_road_is_there(stage):
    importlib.import_module(stage.module)
    module, _, shape = stage.shape.rpartition(".")
    assert hasattr(importlib.import_module(module), shape)


def test_a_missing_room_is_noticed():
    with pytest.raises(LookupError, match="there is no"):
        road.first_sentence("host.kitchen")
    with pytest.raises(LookupError, match="there is no Pan"):
        road.first_sentence("host.links.transport.Pan")
