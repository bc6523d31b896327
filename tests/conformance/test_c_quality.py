"""The C library as code: size, stack, needs, the findings of compilers, checkers and a fuzzer."""

import re
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest

from tests.c_library import budgets, fuzz, lint
from tests.c_library.build import LIBRARY, MissingToolError
from tests.c_library.constants import HEADER, header_text

ROOT = LIBRARY.parents[1]


def or_skip(measure, *arguments):
    try:
        return measure(*arguments)
    except MissingToolError as error:
        pytest.skip(str(error))


def test_the_constants_are_those_of_the_schema():
    assert HEADER.read_text(encoding="utf-8") == header_text(), "run `python -m tests.c_library.constants`"


def test_files_stay_readable():
    files = sorted(LIBRARY.glob("*.[ch]"))
    assert len(files) == 7
    for path in files:
        assert len(path.read_text(encoding="utf-8").splitlines()) <= 400, path.name


def test_no_allocation_and_no_packed_struct():
    for path in LIBRARY.glob("*.[ch]"):
        assert not re.search(r"malloc|calloc|packed|#include <(?!std(bool|def|int)\.h>)", path.read_text()), path.name


def test_it_keeps_its_budgets_on_a_cortex_m0():
    parts = {part.name: part for part in or_skip(budgets.measure)}
    assert parts.keys() == {"rotdrift_protocol", "rotdrift_sequence", "rotdrift_can"}
    assert parts["rotdrift_protocol"].code_bytes <= budgets.MAX_CORE_BYTES
    for part in parts.values():
        assert part.static_bytes == 0
        assert 0 < max(part.frames.values()) <= budgets.MAX_STACK_BYTES
        elsewhere = {name for name in part.needs if not name.startswith(("rd_", "__aeabi_", "__gnu_thumb1_"))}
        assert elsewhere <= {"memcpy"}, part.name
    # The deepest way through the core is longer than any function of it, so the call graph was read.
    core = parts["rotdrift_protocol"]
    assert max(core.frames.values()) < max(core.chains.values()) <= budgets.MAX_STACK_BYTES


@pytest.mark.parametrize("check", lint.CHECKS)
def test_compilers_and_checkers_find_nothing(check):
    assert or_skip(lint.CHECKS[check]) == ""


def test_a_warning_would_be_seen(tmp_path, monkeypatch):
    source = tmp_path / "bad.c"
    source.write_text("unsigned char narrow(int wide);\nunsigned char narrow(int wide) { return wide; }\n")
    monkeypatch.setattr(lint, "SOURCES", (source,))
    assert "conversion" in or_skip(lint.gcc)


def test_a_short_run_of_the_fuzzer_finds_nothing():
    done = or_skip(fuzz.run, 4000)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "stat::number_of_executed_units: 4000" in done.stderr


def test_the_package_ships_no_c():
    """The library is of the repository; firmware_protocol.can, whose name starts the same, is still shipped."""
    discovery = pytest.importorskip("setuptools.discovery")
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    packages = discovery.PEP420PackageFinder.find(str(ROOT), **settings["packages"]["find"])
    assert {"firmware_protocol", "firmware_protocol.can"} <= set(packages)
    shipped = [
        path
        for package in packages
        for path in (ROOT / package.replace(".", "/")).iterdir()
        if path.is_file() and any(fnmatch(path.name, glob) for glob in ["*.py", *settings["package-data"]["*"]])
    ]
    assert ROOT / "firmware_protocol" / "sensorized_object.dbc" in shipped
    assert not [path for path in shipped if path.suffix in {".c", ".h"} or path.parent == LIBRARY]


def test_the_pages_name_the_library():
    for page in ("docs/protocol.md", "docs/can.md", "README.md", "CONTRIBUTING.md"):
        assert "firmware_protocol/c" in (ROOT / page).read_text(encoding="utf-8"), page


def test_the_library_page_names_every_file_and_command():
    page = (LIBRARY / "README.md").read_text(encoding="utf-8")
    for path in [*LIBRARY.glob("*.[ch]")]:
        assert path.stem in page, path.name
    for command in re.findall(r"python -m (tests\.c_library\.\w+)", page):
        assert Path(ROOT, *command.split(".")).with_suffix(".py").exists(), command
    assert len(set(re.findall(r"python -m tests\.c_library\.(\w+)", page))) == 5
