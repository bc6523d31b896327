"""A set-up today and one next year agree, to the byte: versions and hashes of all that any of them brings."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from release import lock

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
PIN = re.compile(r"^([\w.-]+)==([^\s;]+)", re.MULTILINE)
EXTRAS = tuple(PROJECT["project"]["optional-dependencies"])
SETS = {path.stem: path.read_text() for path in sorted((ROOT / "requirements").glob("*.txt"))}
RENEW = "run `make lock`"


def pins(text):
    return {canonicalize_name(name): version for name, version in PIN.findall(text)}


PINS = pins((ROOT / "constraints.txt").read_text())


def needed_by(distribution, extras):
    """Requirements of a distribution that hold here, with any of these extras."""
    for line in requires(distribution) or ():
        requirement = Requirement(line)
        if requirement.marker is None or any(requirement.marker.evaluate({"extra": extra}) for extra in extras):
            yield requirement


def declared(*extras):
    """What pyproject.toml declares, with these extras; not what it declared when it was installed here."""
    lines = [*PROJECT["project"]["dependencies"]]
    for extra in extras:
        lines += PROJECT["project"]["optional-dependencies"][extra]
    for requirement in map(Requirement, lines):
        if requirement.name == "rotdrift":
            yield from declared(*requirement.extras)
        elif requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            yield requirement


def closure(*extras):
    """Every distribution that a set-up needs, as far as those installed here name it, with who needs it."""
    found = {}
    waiting = [(requirement, "rotdrift") for requirement in declared(*extras)]
    while waiting:
        requirement, user = waiting.pop()
        key = canonicalize_name(requirement.name)
        if key in found:
            continue
        found[key] = user
        try:
            waiting += [(needed, key) for needed in needed_by(key, ("", *requirement.extras))]
        except PackageNotFoundError:
            continue  # of an extra that is not installed here
    return found


def test_every_package_is_pinned():
    assert {name: user for name, user in closure(*EXTRAS).items() if name not in PINS} == {}, RENEW


def test_the_file_holds_pins_and_nothing_else():
    lines = (ROOT / "constraints.txt").read_text().splitlines()[1:]
    assert len(lines) == len(PINS) > 100
    assert lines == sorted(lines, key=lambda line: line.lower().replace("_", "-"))


def test_what_is_declared_is_what_is_pinned():
    """A pin outside the declared range could never be installed."""
    for requirement in [*declared(*EXTRAS), *map(Requirement, PROJECT["build-system"]["requires"])]:
        assert requirement.specifier.contains(PINS[canonicalize_name(requirement.name)]), requirement


@pytest.mark.parametrize("name", SETS)
def test_every_version_in_a_set_is_the_pinned_one_and_has_hashes(name):
    blocks = re.findall(r"^\S.*\n(?:[ \t].*\n)*", SETS[name], re.MULTILINE)
    for block in blocks:
        if not block.startswith(("#", "-r run.txt\n")):
            ((package, version),) = pins(block).items()
            assert PINS[package] == version, RENEW
            assert re.fullmatch(r"\S+( ; [^\\]+)?(?: \\\n    --hash=sha256:[0-9a-f]{64})+\n", block), block
    assert len(blocks) > 1


@pytest.mark.parametrize("name", [name for name in SETS if name != "build"])
def test_a_set_holds_all_that_it_needs(name):
    there = pins(SETS["run"]) | pins(SETS[name])
    extras = () if name == "run" else (name,)
    assert {package: user for package, user in closure(*extras).items() if package not in there} == {}, RENEW


def test_a_set_for_another_system_holds_what_that_needs():
    """Made for all of them at once: packages of Windows and macOS alone are in it, with their condition."""
    assert re.search(r"^colorama==\S+ ; .*sys_platform == 'win32'", SETS["run"] + SETS["dev"], re.MULTILINE)
    assert re.search(r"^appnope==\S+ ; .*sys_platform == 'darwin'", SETS["dev"], re.MULTILINE)


def test_nothing_is_installed_but_by_hash():
    lines = [line for line in (ROOT / "Makefile").read_text().splitlines() if "$(PIP)" in line or "$(LOCKED)" in line]
    assert lines[0] == "LOCKED := $(PIP) --require-hashes"
    assert lines[1].startswith("EDITABLE := ")
    assert "$(PIP) --no-deps --editable ." in lines[1]
    assert len(lines) > 5
    for line in lines[2:]:
        assert "$(LOCKED) -r" in line, line
    assert "pip install" not in (ROOT / ".ci" / "run").read_text()


def test_what_was_resolved_becomes_pins_and_two_versions_of_one_package_are_refused():
    resolved = "b==2 ; sys_platform == 'win32'\nA_c==1.0 \\\n    --hash=sha256:0\nb==2\n"
    assert lock.pins(resolved) == "A_c==1.0\nb==2\n"
    assert [block.split("==")[0] for block in lock.blocks(resolved)] == ["b", "A_c", "b"]
    with pytest.raises(ValueError, match="more than one version of b"):
        lock.pins(resolved + "b==3 ; python_version < '3.12'\n")


def test_an_audit_that_could_not_ask_about_a_package_fails():
    (line,) = (line for line in (ROOT / "Makefile").read_text().splitlines() if "pip-audit" in line)
    assert "--strict" in line


@pytest.mark.parametrize("path", sorted((ROOT / ".github" / "workflows").glob("*.yml")), ids=lambda path: path.stem)
def test_workflows_use_actions_by_commit_and_have_no_right_that_they_do_not_name(path):
    text = path.read_text()
    used = re.findall(r"uses: (.*)", text)
    assert all(re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", action) for action in used), used
    assert "\npermissions:\n  contents: read\n" in text
    assert text.count("timeout-minutes:") == text.count("runs-on:")
    for line in re.findall(r"^.*pip install.*$", text, re.MULTILINE):
        assert "--require-hashes" in line or "--no-deps ." in line, line


def test_versions_and_actions_are_renewed_once_a_month():
    assert re.search(r'cron: "\d+ \d+ \d+ \* \*"', (ROOT / ".github/workflows/update.yml").read_text())
    assert "make lock UPGRADE=1" in (ROOT / ".github/workflows/update.yml").read_text()
    dependabot = (ROOT / ".github/dependabot.yml").read_text()
    assert "github-actions" in dependabot
    assert "interval: monthly" in dependabot
