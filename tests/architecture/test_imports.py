"""The rules of the house, held by a test as well as by the linter."""

import ast
import functools
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from importlinter import api

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("analysis", "emulator", "firmware_protocol", "host")
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


@functools.cache
def imported(path):
    """Top-level names a file imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names


def test_the_import_contracts_are_declared():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    assert len(contracts) >= 7
    assert api.read_configuration()["session_options"]["root_packages"] == sorted(PACKAGES)


@pytest.mark.parametrize(
    ("package", "forbidden"),
    [
        ("firmware_protocol", {"analysis", "emulator", "host", "serial", "can"}),
        ("emulator", {"analysis", "host", "scipy", "matplotlib"}),
        ("analysis", {"emulator", "host", "firmware_protocol", "serial", "can"}),
    ],
)
def test_rooms_do_not_look_into_each_other(package, forbidden):
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] == package:
            assert imported(path) & forbidden == set(), path


@pytest.mark.parametrize(
    ("library", "homes"),
    [
        ("construct", ["firmware_protocol/schema.py"]),
        ("serial", ["host/links/", "emulator/links/"]),
        ("can", ["host/links/", "emulator/links/"]),
        ("matplotlib", ["analysis/reporting/"]),
        ("plotly", ["analysis/reporting/"]),
        ("jinja2", ["analysis/reporting/"]),
        ("fpdf", ["analysis/reporting/"]),
        ("mcap", ["host/record", "analysis/formats/ros/"]),
        ("rich", ["host/"]),
        ("minisign", ["host/submission/", "host/commands/report.py"]),
        ("emulator", ["host/commands/", "emulator/"]),
    ],
)
def test_libraries_are_met_where_they_live(library, homes):
    for path in SOURCES:
        name = path.relative_to(ROOT).as_posix()
        if library in imported(path):
            assert any(name.startswith(home) for home in homes), f"{name} imports {library}"


def test_no_module_is_named_like_something_else():
    taken = set(sys.stdlib_module_names) | {
        name for name, distributions in packages_distributions().items() if "rotdrift" not in distributions
    }
    assert set(PACKAGES) & taken == set()
    assert not {"utils", "helpers", "types", "misc", "common"} & {path.stem for path in SOURCES}


def test_commands_import_nothing_heavy_before_they_run():
    light = set(sys.stdlib_module_names) | {"host"}
    for path in sorted((ROOT / "host" / "commands").glob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in tree.body:
            if isinstance(node, ast.Import):
                assert {alias.name.split(".")[0] for alias in node.names} <= light, path
            elif isinstance(node, ast.ImportFrom):
                assert (node.module or "").split(".")[0] in light - {"host"}, path


def test_only_the_command_line_calls_a_command():
    for path in SOURCES:
        name = path.relative_to(ROOT).as_posix()
        if name != "host/cli.py" and not name.startswith("host/commands/"):
            assert "host.commands" not in path.read_text(encoding="utf-8"), name


def test_files_stay_readable():
    for path in SOURCES:
        n = len(path.read_text(encoding="utf-8").splitlines())
        assert n <= 400, f"{path.relative_to(ROOT)} has {n} lines: it wants to be two"


def test_every_package_is_typed():
    for package in PACKAGES:
        assert (ROOT / package / "py.typed").exists()
