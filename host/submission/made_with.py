"""The versions a submission is made with, and which of them decide the bytes of a file.

Tables, JSON and texts hold numbers, and numbers can be compared whatever computed them. Drawings, reports and parquet
can not: another release of a library draws or packs the same numbers as other bytes.
"""

from __future__ import annotations

import functools
import hashlib
import platform
import re
import zlib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from analysis.reporting.figure_set import CAPTIONS
from analysis.reporting.style import FREETYPE_VERSION
from host.version import VERSION

PACKAGES = ("matplotlib", "kiwisolver", "numpy", "scipy", "pyarrow", "fonttools", "fpdf2", "jinja2", "pillow")
"""Kiwisolver places what matplotlib draws."""
PARQUET = ".parquet"
PROGRAM = {"rotdrift", "code"}
"""What in :func:`made_with` names this program itself: its release, and its code between releases."""
PACKING = {"zlib", "platform"}
"""What decides how the archive is deflated."""
_OF_PARQUET = {*PROGRAM, "pyarrow", "platform"}
_DRAWN = re.compile(rf"report\.(html|pdf)|(figures/summary|trials/[^/]+/figures/({'|'.join(CAPTIONS)}))\.(png|svg|pdf)")
_ROOT = Path(__file__).parents[2]
_CODE_OF_A_SUBMISSION = ("analysis", "firmware_protocol", "host")
_CODE = {".py", ".html", ".css", ".js", ".gz"}


def made_with() -> dict[str, str]:
    """Return the versions that decide the bytes of a submission; without pyarrow it holds no parquet."""
    packages = {name: installed for name in PACKAGES if (installed := _installed(name)) is not None}
    return {
        "rotdrift": VERSION,
        "code": code_digest(),
        "python": platform.python_version(),
        **packages,
        "freetype": FREETYPE_VERSION,
        "zlib": zlib.ZLIB_RUNTIME_VERSION,
        "platform": f"{platform.system()} {platform.machine()}",
    }


@functools.cache
def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@functools.cache
def code_digest() -> str:
    """Return 12 digits of the SHA-256 of this program's code: between two releases it changes, the version does not.

    Line ends do not count, as a checkout on Windows may have others.
    """
    digest = hashlib.sha256()
    for package in _CODE_OF_A_SUBMISSION:
        for path in sorted((_ROOT / package).rglob("*"), key=lambda path: path.relative_to(_ROOT).as_posix()):
            if path.suffix in _CODE and path.is_file():
                content = path.read_bytes()
                content = content if path.suffix == ".gz" else content.replace(b"\r\n", b"\n")
                digest.update(f"{path.relative_to(_ROOT).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:12]


def other_versions(claimed: Mapping[str, str]) -> dict[str, str]:
    """Return what here differs from the versions a submission claims, each as ``name version (here version)``."""
    ours = made_with()
    return {
        name: f"{name} {claimed.get(name, 'none')} (here {ours.get(name, 'none')})"
        for name in dict.fromkeys((*ours, *claimed))
        if ours.get(name) != claimed.get(name)
    }


def is_drawn(name: str) -> bool:
    """Return whether a file is a figure or a report that a submission may hold."""
    return _DRAWN.fullmatch(name) is not None


def decides(library: str, name: str) -> bool:
    """Return whether the version of a library, a key of :func:`made_with`, decides the bytes of a file."""
    return library in _OF_PARQUET if name.endswith(PARQUET) else is_drawn(name) and library != "pyarrow"
