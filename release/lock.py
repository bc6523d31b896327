"""Write the versions and hashes that a set-up installs: ``make lock``, or ``make lock UPGRADE=1`` for new versions.

``constraints.txt`` has one version of each package. From it and pyproject.toml, ``requirements/`` is made: for each set
of packages all that it needs, with the hashes of all files of that version, for every platform and Python from 3.11 on.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CONSTRAINTS = ROOT / "constraints.txt"
FOLDER = ROOT / "requirements"
HEADING = "# Every version a set-up uses, so that today's and next year's agree. Renew by: see CONTRIBUTING.md.\n"
MADE = "# Made by `make lock` from pyproject.toml and constraints.txt.\n"
SETS = ("dev", "docs", "bench", "c", "fuzz", "mutation", "release")
"""Extras that are set up on their own; ``run`` has what the program needs, ``build`` what builds it."""
FIRST_PYTHON = "3.11"
DOCS_PYTHON = "3.11.5"
"""The tools of the documentation need a later one."""


def resolve(*options: str, stdin: str = "", python: str = FIRST_PYTHON) -> str:
    """Return what ``uv pip compile`` prints for every platform."""
    command = [sys.executable, "-m", "uv", "pip", "compile", "--universal", "--quiet", "--no-annotate", "--no-header"]
    command += ["--python-version", python, *options, "-" if stdin else "pyproject.toml"]
    done = subprocess.run(command, cwd=ROOT, input=stdin, capture_output=True, text=True, check=False, timeout=300)  # noqa: S603
    if done.returncode:
        sys.exit(f"the packages do not fit together:\n{done.stderr}")
    return done.stdout


def pins(text: str) -> str:
    """Return one ``name==version`` a line, sorted as people do, of what was resolved.

    Raises
    ------
    ValueError
        A package would have other versions on other platforms: nobody could tell what was tested.
    """
    found = sorted(set(re.findall(r"^[\w.-]+==[^\s;]+", text, re.MULTILINE)), key=sorting)
    names = [line.partition("==")[0] for line in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"more than one version of {', '.join(twice)}: limit it in pyproject.toml")
    return "".join(f"{line}\n" for line in found)


def sorting(line: str) -> str:
    """Return what a line of constraints.txt is sorted by."""
    return line.lower().replace("_", "-")


def blocks(text: str) -> list[str]:
    """Return the requirements of a file, each with its hashes."""
    return re.findall(r"^\S.*\n(?:[ \t].*\n)*", text, re.MULTILINE)


def main() -> int:
    """Write constraints.txt and the files in ``requirements/``."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--upgrade", action="store_true", help="take the newest versions that fit together")
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    kept = [] if parser.parse_args().upgrade else ["--constraints", str(CONSTRAINTS)]
    everything = resolve("--all-extras", "--fork-strategy", "fewest", *kept, python=DOCS_PYTHON)
    everything += resolve(*kept, stdin="\n".join(build))
    CONSTRAINTS.write_text(HEADING + pins(everything), encoding="utf-8")
    locked = ["--generate-hashes", "--constraints", str(CONSTRAINTS)]
    FOLDER.mkdir(exist_ok=True)
    (FOLDER / "build.txt").write_text(MADE + resolve(*locked, stdin="\n".join(build)), encoding="utf-8")
    run = resolve(*locked)
    (FOLDER / "run.txt").write_text(MADE + run, encoding="utf-8")
    for name in SETS:
        python = DOCS_PYTHON if name == "docs" else FIRST_PYTHON
        more = [block for block in blocks(resolve(*locked, "--extra", name, python=python)) if block not in blocks(run)]
        (FOLDER / f"{name}.txt").write_text(MADE + "-r run.txt\n" + "".join(more), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
