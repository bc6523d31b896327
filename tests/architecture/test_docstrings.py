"""Docstrings speak one dialect: numpydoc's sections with `name : type`, and "Return ..." for what is returned."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["numpydoc_validation"]
NAMES = [
    path.relative_to(ROOT).as_posix()
    for package in ("analysis", "emulator", "firmware_protocol", "host")
    for path in sorted((ROOT / package).rglob("*.py"))
]
FILES = [name for name in NAMES if not any(re.search(left_out, name) for left_out in SETTINGS.get("exclude_files", ()))]
SYNONYMS = {"Give", "Gives", "Tell", "Tells", "Say", "Says", "Lay", "Returns"}
QUESTIONS = {"Whether", "What", "How", "When", "Where", "Why", "Which", "Who", "The", "A", "An"}
"""Openings of a property; a function opens with a verb."""


def test_sections_and_parameters_are_numpydoc_s():
    command = [sys.executable, "-m", "numpydoc", "lint", *FILES]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr


def opening_fault(function: ast.FunctionDef) -> str:
    """What is wrong with the first word of a docstring; empty where nothing is."""
    text = ast.get_docstring(function) or ""
    first = re.match(r"\w+(?= )", text)
    returns = ast.unparse(function.returns) if function.returns is not None else "None"
    if first is None or returns in {"None", "NoReturn"}:
        return ""
    is_property = any("property" in ast.unparse(decorator) for decorator in function.decorator_list)
    wrong = SYNONYMS if is_property else SYNONYMS | QUESTIONS
    return f"{function.lineno}: {function.name}: {first[0]} ..." if first[0] in wrong else ""


def test_a_function_that_returns_something_opens_with_a_verb_and_that_is_return():
    faults = [
        f"{name}:{fault}"
        for name in FILES
        for node in ast.walk(ast.parse((ROOT / name).read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and (fault := opening_fault(node))
    ]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("source", "wrong"),
    [
        ('def f() -> int:\n    """Give a number."""', True),
        ('def f() -> bool:\n    """Whether it is."""', True),
        ('def f() -> int:\n    """Return a number."""', False),
        ('def f() -> int:\n    """Count the samples."""', False),
        ('def f() -> None:\n    """Tell the object to stop."""', False),
        ('@property\ndef f() -> bool:\n    """Whether it is."""', False),
    ],
)
def test_an_opening_is_judged_by_what_the_function_returns(source, wrong):
    function = ast.parse(source).body[0]
    assert isinstance(function, ast.FunctionDef)
    assert bool(opening_fault(function)) is wrong
