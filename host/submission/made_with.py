"""The versions a submission is made with, and which of them decide the bytes of a file.

Tables, JSON and texts hold numbers, and numbers can be compared whatever computed them. Drawings, reports and parquet
can not: another release of a library draws or packs the same numbers as other bytes.
"""

from __future__ import annotations

import platform
import zlib
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

from analysis.reporting.style import FREETYPE_VERSION
from host.version import VERSION

PACKAGES = ("matplotlib", "numpy", "scipy", "pyarrow", "fonttools", "fpdf2", "jinja2", "pillow")
REPORTS = ("report.html", "report.pdf")
FIGURES = (".png", ".svg", ".pdf")
PARQUET = ".parquet"
_OF_PARQUET = {"rotdrift", "pyarrow", "platform"}


def made_with() -> dict[str, str]:
    """Return the versions that decide the bytes of a submission; without pyarrow it holds no parquet."""
    packages = {}
    for name in PACKAGES:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            continue
    return {
        "rotdrift": VERSION,
        "python": platform.python_version(),
        **packages,
        "freetype": FREETYPE_VERSION,
        "zlib": zlib.ZLIB_RUNTIME_VERSION,
        "platform": f"{platform.system()} {platform.machine()}",
    }


def other_versions(claimed: Mapping[str, str]) -> dict[str, str]:
    """Return what here differs from the versions a submission claims, each as ``name version (here version)``."""
    ours = made_with()
    return {
        name: f"{name} {claimed.get(name, 'none')} (here {ours.get(name, 'none')})"
        for name in dict.fromkeys((*ours, *claimed))
        if ours.get(name) != claimed.get(name)
    }


def is_drawn(name: str) -> bool:
    """Return whether a file is a figure or a report."""
    return name in REPORTS or ("figures/" in name and name.endswith(FIGURES))


def decides(library: str, name: str) -> bool:
    """Return whether the version of a library, a key of :func:`made_with`, decides the bytes of a file."""
    return library in _OF_PARQUET if name.endswith(PARQUET) else is_drawn(name) and library != "pyarrow"
