"""A set-up today and one next year agree: every package that any of them brings is pinned."""

import re
from importlib.metadata import PackageNotFoundError, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
PINS = {
    canonicalize_name(name): version
    for name, version in re.findall(r"^([\w.-]+)==(\S+)$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
}
EXTRAS = ("", "multicast", "parquet", "ros", "bench", "c", "docs", "fuzz", "dev")


def needed_by(distribution, extras):
    """Requirements of a distribution that hold here, with any of these extras."""
    for line in requires(distribution) or ():
        requirement = Requirement(line)
        if requirement.marker is None or any(requirement.marker.evaluate({"extra": extra}) for extra in extras):
            yield requirement


def closure():
    """Every distribution that a set-up needs, as far as those installed here say, with who needs it."""
    found = {}
    waiting = [("rotdrift", EXTRAS)]
    while waiting:
        name, extras = waiting.pop()
        try:
            needed = list(needed_by(name, extras))
        except PackageNotFoundError:
            continue  # of an extra that is not installed here
        for requirement in needed:
            key = canonicalize_name(requirement.name)
            if key not in found:
                found[key] = name
                waiting.append((key, ("", *requirement.extras)))
    return found


def test_every_package_is_pinned():
    missing = {name: user for name, user in closure().items() if name not in PINS and name != "rotdrift"}
    assert missing == {}, "write them into constraints.txt"


def test_the_file_holds_pins_and_nothing_else():
    lines = (ROOT / "constraints.txt").read_text().splitlines()[1:]
    assert len(lines) == len(PINS) > 100
    assert lines == sorted(lines, key=lambda line: line.lower().replace("_", "-"))


def test_what_is_declared_is_what_is_pinned():
    """A pin outside the declared range could never be installed."""
    for requirement in needed_by("rotdrift", EXTRAS):
        if requirement.name != "rotdrift":
            assert requirement.specifier.contains(PINS[canonicalize_name(requirement.name)]), requirement
