"""Start of the ``rotdrift`` command: make sure that our packages are ours, then hand over to :mod:`host.cli`.

``analysis``, ``emulator``, ``firmware_protocol`` and ``host`` are generic names: another distribution, or a ``host.py``
on the path, can hide ours. A hidden ``host`` cannot report it itself, therefore this is a module of its own.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path

PACKAGES = {
    "analysis": "series.py",
    "emulator": "runner.py",
    "firmware_protocol": "packets.py",
    "host": "cli.py",
}
"""Package -> a file of it by which ours is known, should another one be installed over it."""

WRONG_USE = 2


def hidden_package(root: Path) -> str | None:
    """Name the first of our packages that is hidden by something else, and by what.

    Parameters
    ----------
    root : Path
        The folder that holds this module and our packages.

    Returns
    -------
    str or None
        One sentence with a remedy; None when all four are ours.
    """
    for name, known_by in PACKAGES.items():
        try:
            spec = importlib.util.find_spec(name)
        except (ImportError, ValueError) as error:
            return f"our package {name} cannot be imported ({error}): install rotdrift again"
        ours = root / name / "__init__.py"
        if spec is None:
            return f"our package {name} is missing: install rotdrift again"
        origin = Path(spec.origin) if spec.origin else Path(next(iter(spec.submodule_search_locations or [name])))
        if not (_same_file(origin, ours) and (root / name / known_by).is_file()):
            return (
                f"{origin} hides our package {name}: remove or rename it, leave its folder out of PYTHONPATH, "
                "or install rotdrift in a virtual environment of its own"
            )
    return None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; see ``rotdrift --help``.

    Returns
    -------
    int
        0 done, 1 not valid, 2 wrong use, 3 device or link, 4 file.
    """
    problem = hidden_package(Path(__file__).resolve().parent)
    if problem:
        shown = "".join(filter(str.isprintable, problem))  # it names a path; nothing else can be imported yet
        print(f"rotdrift: {shown}", file=sys.stderr)  # noqa: T201
        return WRONG_USE
    from host.cli import main as run

    return run(arguments)


def _same_file(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return False


if __name__ == "__main__":
    sys.exit(main())
