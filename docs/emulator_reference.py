"""The reference tables of ``docs/emulator.md``, made from the code: ``python -m docs.emulator_reference`` writes them.

A test compares the document with what this makes.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from docs.source_reading import filled, meanings
from emulator.scenario import Scenario, load_scenario, scenario_names

PAGE = Path(__file__).with_name("emulator.md")


def scenario_table() -> str:
    """Return the shipped scenarios and what each is for, as a Markdown table."""
    rows = [f"| `{name}` | {load_scenario(name).purpose} |" for name in scenario_names()]
    return "\n".join(["| scenario | what it is for |", "|---|---|", *rows])


def _toml(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _key_table(cls: type[Any], title: str) -> list[str]:
    documented, rows, nested = meanings(cls), [], []
    for field in dataclasses.fields(cls):
        rule = field.metadata.get("rule")
        if rule is None:
            continue
        inner = getattr(rule, "cls", None)
        if inner is not None:
            name = f"{title}.{field.name}".removeprefix("top.")
            nested += _key_table(inner, name if not rule.many else f"[{name}]")
        else:
            rows.append(f"| `{field.name}` | `{_toml(field.default)}` | {rule.allowed} | {documented[field.name]} |")
    heading = "At the top" if title == "top" else f"`[{title}]`"
    return [f"### {heading}", "", "| key | default | allowed | meaning |", "|---|---|---|---|", *rows, "", *nested]


def key_tables() -> str:
    """Return every key of a scenario with its default, its range and its meaning, as Markdown tables."""
    return "\n".join(_key_table(Scenario, "top")).rstrip()


def fill(document: str) -> str:
    """Return a document with its two marked places filled from the code."""
    return filled(document, {"scenarios": scenario_table(), "keys": key_tables()})


if __name__ == "__main__":
    PAGE.write_text(fill(PAGE.read_text()))
