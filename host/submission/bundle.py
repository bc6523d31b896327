"""The files of a submission with their checksums, as one archive or as the folder it was unpacked to.

``SHA256SUMS`` lists every other file (``sha256sum -c SHA256SUMS`` checks it too).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

from host.errors import reason_of
from host.submission.archive import MAX_ENTRIES, MAX_TOTAL_BYTES, BundleError, archive_bytes, read_archive
from host.text import plain

MANIFEST = "SHA256SUMS"


def manifest_text(files: Mapping[str, bytes]) -> str:
    """Return the manifest: one line ``sha256  name`` per file but itself, sorted by name."""
    return "".join(f"{hashlib.sha256(files[name]).hexdigest()}  {name}\n" for name in sorted(files) if name != MANIFEST)


def bundle_bytes(files: Mapping[str, bytes]) -> bytes:
    """Return the archive of files by name (forward slashes), with a new manifest; the same content, the same bytes.

    Raises
    ------
    BundleError
        A name that a reader would refuse.
    """
    return archive_bytes({**files, MANIFEST: manifest_text(files).encode()})


def read_bundle(path: Path) -> dict[str, bytes]:
    """Read every file of an archive, the manifest included, into memory, within limits; return them by name.

    Raises
    ------
    BundleError
        There is no such file, or it is refused; one sentence names why.
    """
    return read_archive(archive_at(path))


def archive_at(path: Path) -> bytes:
    """Return the bytes of an archive; raises BundleError where there is no such file, or it is too large."""
    try:
        if not path.is_file() or path.stat().st_size > MAX_TOTAL_BYTES:
            there = f"refused: not a file, or larger than {MAX_TOTAL_BYTES} bytes"
            raise BundleError(there if path.exists() else f"there is no file {plain(path)}")
        return path.read_bytes()
    except OSError as error:
        raise BundleError(f"it cannot be read ({plain(reason_of(error))})") from error


def read_folder(folder: Path) -> dict[str, bytes]:
    """Read every file of an unpacked bundle into memory, within the same limits; links are refused.

    Raises
    ------
    BundleError
        A link, or more than a bundle may hold.
    """
    files: dict[str, bytes] = {}
    total = 0
    for place in sorted(folder.rglob("*")):
        name = place.relative_to(folder).as_posix()
        if place.is_symlink() or not (place.is_file() or place.is_dir()):
            raise BundleError(f"refused: {plain(name)} is a link or device, not a file")
        if place.is_dir():
            continue
        total += place.stat().st_size
        if total > MAX_TOTAL_BYTES or len(files) >= MAX_ENTRIES:
            raise BundleError("refused: more than a submission may hold")
        files[name] = place.read_bytes()
    return files


def check_manifest(files: Mapping[str, bytes]) -> tuple[str, ...]:
    """Return one sentence for each file that is altered, missing or not listed in the manifest.

    Raises
    ------
    BundleError
        There is no manifest, or a line of it is not one.
    """
    if MANIFEST not in files:
        raise BundleError(f"there is no {MANIFEST}: this is not a bundle of rotdrift")
    listed: dict[str, str] = {}
    for number, line in enumerate(files[MANIFEST].decode("utf-8", "replace").splitlines(), start=1):
        digest, gap, name = line[:64], line[64:66], line[66:]
        if gap != "  " or len(digest) != 64 or not set(digest) <= set("0123456789abcdef") or name in listed:
            raise BundleError(f"line {number} of {MANIFEST} is not a checksum and a name")
        listed[name] = digest
    found = []
    for name in sorted(set(listed) | set(files) - {MANIFEST}):
        if name not in files:
            found.append(f"{plain(name)} is missing")
        elif name not in listed:
            found.append(f"{plain(name)} is not in {MANIFEST}")
        elif hashlib.sha256(files[name]).hexdigest() != listed[name]:
            found.append(f"{plain(name)} is not what {MANIFEST} lists: it was altered")
    if files[MANIFEST] != "".join(f"{listed[name]}  {name}\n" for name in sorted(listed)).encode():
        found.append(f"{MANIFEST} is not written as rotdrift writes it: it was altered")
    return tuple(found)
