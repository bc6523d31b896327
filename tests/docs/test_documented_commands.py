"""Every ``rotdrift`` line in README and docs is a command with options that exist; every link leads somewhere."""

import contextlib
import re
import shlex
from pathlib import Path

import pytest

from host.cli import build_parser

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
BLOCK = re.compile(r"^[ ]*```(?:sh|console|bash|text)?\n(.*?)^[ ]*```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^ {4,}(rotdrift .*)$", re.MULTILINE)
INLINE = re.compile(r"`(rotdrift [a-z][^`]*)`")


def commands(page):
    text = page.read_text(encoding="utf-8")
    lines = [line.strip().removeprefix("$ ") for block in BLOCK.findall(text) for line in block.splitlines()]
    lines += [line.strip() for line in INDENTED.findall(text.replace(" \\\n", " "))]
    found = list(
        dict.fromkeys(" ".join(line.split("   #")[0].split()) for line in lines if line.startswith("rotdrift "))
    )
    return found + [" ".join(line.split()) for line in INLINE.findall(text)]


DOCUMENTED = [(page.relative_to(ROOT).as_posix(), line) for page in PAGES for line in commands(page)]


def test_the_pages_hold_commands():
    assert len(DOCUMENTED) > 20


@pytest.mark.parametrize(("page", "line"), DOCUMENTED)
def test_documented_commands_exist(page, line, capsys):
    words = shlex.split(line.split("   #")[0].split(" > ")[0].split(" | ")[0].rstrip("&;"), comments=True)
    words = [word.strip("[]") for word in words if word != "…"]
    with contextlib.suppress(SystemExit):
        build_parser().parse_args(words[2:] if words[1:2] == ["help"] else words[1:])
    said = capsys.readouterr().err
    # In running text a command may stand without what it needs; an unknown one, or an unknown option, may not.
    assert not said or "required" in said or "expected" in said, f"{page}: {line}\n{said}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_between_pages_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if "://" not in target and not target.startswith("mailto:"):
            assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_every_page_is_in_the_navigation():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in (ROOT / "docs").rglob("*.md"):
        assert page.relative_to(ROOT / "docs").as_posix() in navigation, f"{page.name} is not in mkdocs.yml"
