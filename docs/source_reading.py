"""What the pages made from the code share: the docstrings of a class's fields, and the marked places of a page."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping
from typing import Any

_START, _END = "<!-- made from the code: {} -->", "<!-- end of {} -->"


def meanings(cls: type[Any]) -> dict[str, str]:
    """Return the docstrings of a class's fields, on one line each."""
    (definition,) = ast.parse(inspect.getsource(cls)).body
    assert isinstance(definition, ast.ClassDef)
    found = {}
    for field, doc in zip(definition.body, definition.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(doc, ast.Expr):
            assert isinstance(doc.value, ast.Constant)
            found[field.target.id] = " ".join(str(doc.value.value).replace("``", "`").split())
    return found


def filled(document: str, places: Mapping[str, str]) -> str:
    """Return a document with its marked places filled."""
    for name, made in places.items():
        start, end = _START.format(name), _END.format(name)
        head, found, rest = document.partition(start)
        _, also_found, tail = rest.partition(end)
        assert found, f"the page has no place for {name}"
        assert also_found, f"the place for {name} has no end"
        document = f"{head}{start}\n\n{made}\n\n{end}{tail}"
    return document
