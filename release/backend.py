"""The build backend: setuptools, then archives whose bytes depend on the sources alone.

Setuptools writes the time, the owner and the modes of files into wheel and sdist, and the time of the build into the
gzip header. Here both archives are written again without them: entries in the order of their names, with the date of
``SOURCE_DATE_EPOCH`` (https://reproducible-builds.org/specs/source-date-epoch/) or 1980 where it is not set, no owner,
and the mode of a plain file.
"""

from __future__ import annotations

import gzip
import io
import os
import tarfile
import time
import zipfile
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import (
    build_editable,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]

EARLIEST_S = 315_532_800
"""1980-01-01: what a zip file can hold at the earliest."""
FILE, FOLDER = 0o644, 0o755

Settings = dict[str, Any] | None


def build_wheel(wheel_directory: str, config_settings: Settings = None, metadata_directory: str | None = None) -> str:
    """Build a wheel; return its name."""
    name: str = build_meta.build_wheel(wheel_directory, config_settings, metadata_directory)
    path = Path(wheel_directory) / name
    path.write_bytes(same_zip(path.read_bytes(), source_date_s()))
    return name


def build_sdist(sdist_directory: str, config_settings: Settings = None) -> str:
    """Build a source distribution; return its name."""
    name: str = build_meta.build_sdist(sdist_directory, config_settings)
    path = Path(sdist_directory) / name
    path.write_bytes(same_tar(path.read_bytes(), source_date_s()))
    return name


def source_date_s() -> int:
    """Return the date of the sources, seconds since 1970."""
    return max(EARLIEST_S, int(os.environ.get("SOURCE_DATE_EPOCH", EARLIEST_S)))


def same_zip(content: bytes, date_s: int) -> bytes:
    """Return a zip archive with the same files in the same order, all of one date."""
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as old, zipfile.ZipFile(out, "w") as new:
        for name in old.namelist():  # in setuptools' order: by name, the record of all files last
            entry = zipfile.ZipInfo(name, time.gmtime(date_s)[:6])
            entry.create_system = 3  # Unix, wherever it is built
            entry.external_attr = (0o100000 | FILE) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            new.writestr(entry, old.read(name), compresslevel=9)
    return out.getvalue()


def same_tar(content: bytes, date_s: int) -> bytes:
    """Return a compressed tar archive with the same files by name, of one date and no owner."""
    out = io.BytesIO()
    with (
        tarfile.open(fileobj=io.BytesIO(content)) as old,
        gzip.GzipFile(fileobj=out, mode="wb", filename="", mtime=date_s, compresslevel=9) as packed,
        tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as new,
    ):
        for entry in sorted(old.getmembers(), key=lambda member: member.name):
            clean = tarfile.TarInfo(entry.name)
            clean.type, clean.size, clean.mtime = entry.type, entry.size, date_s
            clean.mode = FOLDER if entry.isdir() else FILE
            new.addfile(clean, old.extractfile(entry) if entry.isfile() else None)
    return out.getvalue()
