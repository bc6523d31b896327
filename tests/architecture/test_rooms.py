"""The house as docs/architecture.md describes it: few rooms, few modules in each, one name for one thing."""

import ast
import tomllib
from collections import Counter, defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("analysis", "emulator", "firmware_protocol", "host")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
FOLDERS = sorted({path.parent for path in SOURCES})
ONE_FILE_A_THING = {"commands", "devices", "formats"}
MAX_MODULES = 14
SAME_ROLE = {"errors", "settings", "decoder", "listing"}
"""Names that mean the same in every room: what it raises, its settings, frames in and packets out, what there is."""


def modules(folder):
    return sorted(path.stem for path in folder.glob("*.py") if not path.stem.startswith("__"))


@pytest.mark.parametrize(("package", "most"), [("host", 6), ("analysis", 2), ("firmware_protocol", 8), ("emulator", 8)])
def test_few_modules_stand_outside_a_room(package, most):
    assert len(modules(ROOT / package)) <= most


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.relative_to(ROOT).as_posix())
def test_a_room_is_small_and_its_names_have_no_common_prefix(folder):
    names = modules(folder)
    assert folder.name in ONE_FILE_A_THING or len(names) <= MAX_MODULES
    prefixes = Counter(name.partition("_")[0] for name in names)
    assert {prefix: n for prefix, n in prefixes.items() if n >= 3} == {}, "three siblings with a prefix are a room"


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_is_there_twice_under_one_name(package):
    places = defaultdict(list)
    for path in (ROOT / package).rglob("*.py"):
        if path.stem not in SAME_ROLE and not path.stem.startswith("__"):
            places[path.stem].append(path.relative_to(ROOT).as_posix())
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_every_room_stands_on_its_floor():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = {contract["containers"][0]: contract for contract in contracts if contract["type"] == "layers"}
    assert sorted(layers) == sorted(PACKAGES)
    for package, contract in layers.items():
        assert contract["exhaustive"] is True
        assert not contract.get("ignore_imports"), package
        named = {part for layer in contract["layers"] for part in layer.replace("|", ":").replace(" ", "").split(":")}
        there = {p.name for p in FOLDERS if p.parent == ROOT / package} | set(modules(ROOT / package))
        assert named == there


MAX_ATTRIBUTES = 16
FILE_LAYOUTS = {
    "analysis/scoring/result.py": {"Result"},
    "analysis/scoring/result_parts.py": {"Diagnostics"},
    "analysis/scoring/recorded_parts.py": {"LinkAccount"},
    "host/submission/manifest.py": {"TrialEntry"},
    "emulator/faults/definitions.py": {"FaultSettings"},
    "emulator/motion/hand_motion.py": {"MotionSettings"},
}
"""Records whose fields are the keys of one table or object in a file: the file decides how many."""


def attributes(node):
    """Everything a class keeps: fields, and whatever is assigned to self."""
    found = {
        item.target.id for item in node.body if isinstance(item, ast.AnnAssign) and isinstance(item.target, ast.Name)
    }
    for part in ast.walk(node):
        if isinstance(part, ast.Attribute) and isinstance(part.ctx, ast.Store) and isinstance(part.value, ast.Name):
            found |= {part.attr} if part.value.id == "self" else set()
    return found


def test_no_class_keeps_more_than_a_head_can_hold():
    large = {}
    for path in SOURCES:
        name = path.relative_to(ROOT).as_posix()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and node.name not in FILE_LAYOUTS.get(name, set()):
                kept = attributes(node)
                if len(kept) > MAX_ATTRIBUTES:
                    large[f"{name}:{node.name}"] = len(kept)
    assert large == {}
