"""The emulator's document says what the code does."""

import dataclasses
import re
import tomllib

from docs.emulator_reference import PAGE, fill
from emulator.faults.definitions import parse_fault_command
from emulator.links import open_link
from emulator.scenario import Scenario, load_scenario, scenario_names
from emulator.settings import read_table

TEXT = PAGE.read_text()


def test_the_tables_are_those_of_the_code():
    assert fill(TEXT) == TEXT, "run: python -m docs.emulator_reference"


def test_every_scenario_and_every_key_is_there():
    for name in scenario_names():
        assert f"| `{name}` | {load_scenario(name).purpose} |" in TEXT

    def keys(cls, table):
        for field in dataclasses.fields(cls):
            rule = field.metadata.get("rule")
            if rule is not None and getattr(rule, "cls", None) is not None:
                yield from keys(rule.cls, f"{table}.{field.name}".lstrip("."))
            elif rule is not None:
                yield table, field.name

    sections = dict(re.findall(r"^### `\[+([\w.]+)\]+`\n(.*?)(?=^#|\Z)", TEXT, re.MULTILINE | re.DOTALL))
    for table, key in keys(Scenario, ""):
        assert f"| `{key}` |" in (sections[table] if table else TEXT), f"{table}.{key}"


def test_the_example_scenario_works():
    (example,) = re.findall(r"```toml\n(.*?)```", TEXT, re.DOTALL)
    scenario = read_table(Scenario, tomllib.loads(example))
    assert scenario.drift.slip_deg == 6.0
    assert scenario.faults.at[0].kind == "unplug"


def test_the_example_of_a_live_fault_works():
    (example,) = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    names = {}
    exec(example, names)
    assert names["live_faults"].get_nowait() == parse_fault_command("unplug for_s=2")


def test_the_links_are_there():
    for address in ("pty:", "tcp:0", "file:x"):
        open_link(address)
        assert f"`{address.partition(':')[0]}:" in TEXT
