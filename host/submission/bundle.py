"""The bundle as a file: a zip with the same bytes for the same content, and a reader that trusts nothing.

Written: entries sorted, stored with fixed time stamps and attributes, deflate at a fixed level; ``SHA256SUMS`` lists
every other file (``sha256sum -c SHA256SUMS`` checks it too). Read: number of entries, size of each, sum of sizes, ratio
of compression, names that leave the folder, links, duplicates and encryption are limited or refused before anything is
unpacked; what is unpacked must be what the headers claim, and no byte may be left that belongs to no file. Nothing is
ever written to disk while reading.
"""

from __future__ import annotations

import hashlib
import io
import stat
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import BinaryIO

from host.text import plain

MANIFEST = "SHA256SUMS"
ZIP_TIME = (1980, 1, 1, 0, 0, 0)
"""The earliest time a zip can hold; every entry has it."""
DEFLATE_LEVEL = 6

MAX_ENTRIES = 20_000
MAX_FILE_BYTES = 2**30
MAX_TOTAL_BYTES = 2 * 2**30
MAX_RATIO = 200
"""Deflate reaches 1032 at most, and only on nothing but zeros; a recording reaches 3, a CSV 5, a blank SVG some 20."""
RATIO_FREE_BYTES = 10 * 2**20
"""Below this size no ratio is suspicious."""
MAX_NAME = 240
_LOCAL_HEADER, _DIRECTORY_ENTRY, _DIRECTORY_END = 30, 46, 22
"""Sizes of the fixed parts of a zip, B; a name follows the first two."""
_READ_ERRORS = (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, NotImplementedError, RuntimeError)


class BundleError(Exception):
    """A bundle that is refused or cannot be read: not a zip, hostile, damaged, not ours; one sentence names why."""


def manifest_text(files: Mapping[str, bytes]) -> str:
    """Return the manifest: one line ``sha256  name`` per file but itself, sorted by name."""
    return "".join(f"{hashlib.sha256(files[name]).hexdigest()}  {name}\n" for name in sorted(files) if name != MANIFEST)


def bundle_bytes(files: Mapping[str, bytes]) -> bytes:
    """Return the zip of files by name (forward slashes), with its manifest; the same content gives the same bytes.

    Raises
    ------
    BundleError
        A name that a reader would refuse.
    """
    everything = dict(files)
    everything[MANIFEST] = manifest_text(files).encode()
    for name in everything:
        _check_name(name)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(everything):
            entry = zipfile.ZipInfo(name, ZIP_TIME)
            entry.external_attr = (stat.S_IFREG | 0o644) << 16
            entry.create_system = 3  # the same on Windows
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, everything[name], compresslevel=DEFLATE_LEVEL)
    return buffer.getvalue()


def read_bundle(path: Path) -> dict[str, bytes]:
    """Read every file of a bundle, the manifest included, into memory, within limits; return them by name.

    Raises
    ------
    BundleError
        Not a zip, damaged, or refused; one sentence names why.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = sorted(archive.infolist(), key=lambda entry: entry.header_offset)
            directory = archive.start_dir
        _check_entries(entries)
        with path.open("rb") as file:
            files = {entry.filename: _content(file, entry) for entry in entries}
            names = sum(len(entry.FileHeader()) - _LOCAL_HEADER for entry in entries)
            end = file.tell() + names + _DIRECTORY_ENTRY * len(entries) + _DIRECTORY_END
            if file.tell() != directory or path.stat().st_size != end:
                raise BundleError("refused: there are bytes behind the files, or a comment")
    except BundleError:
        raise
    except FileNotFoundError as error:
        raise BundleError(f"there is no file {path}") from error
    except _READ_ERRORS as error:
        raise BundleError(f"{path.name} is not a readable zip ({type(error).__name__}: {error})") from error
    return files


def read_folder(folder: Path) -> dict[str, bytes]:
    """Read every file of an unpacked bundle as :func:`read_bundle`, within the same limits; links are refused.

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
            found.append(f"{name} is missing")
        elif name not in listed:
            found.append(f"{name} is not in {MANIFEST}")
        elif hashlib.sha256(files[name]).hexdigest() != listed[name]:
            found.append(f"{name} is not what {MANIFEST} says: it was altered")
    if files[MANIFEST] != "".join(f"{listed[name]}  {name}\n" for name in sorted(listed)).encode():
        found.append(f"{MANIFEST} is not written as rotdrift writes it: it was altered")
    return tuple(found)


def _check_entries(entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MAX_ENTRIES:
        raise BundleError(f"refused: {len(entries)} files, more than {MAX_ENTRIES}")
    seen: set[str] = set()
    total = 0
    for entry in entries:
        _check_name(entry.filename)
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in {0, stat.S_IFREG}:
            raise BundleError(f"refused: {plain(entry.filename)} is a link or device, not a file")
        if entry.flag_bits & 0x1:
            raise BundleError(f"refused: {plain(entry.filename)} is encrypted")
        if entry.filename.lower() in seen:
            raise BundleError(f"refused: {plain(entry.filename)} is there twice")
        seen.add(entry.filename.lower())
        total += entry.file_size
        if max(entry.file_size, entry.compress_size) > MAX_FILE_BYTES or total > MAX_TOTAL_BYTES:
            raise BundleError(f"refused: {plain(entry.filename)} claims {entry.file_size} bytes, {total} in all so far")
        ratio = entry.file_size / max(entry.compress_size, 1)
        if entry.file_size > RATIO_FREE_BYTES and ratio > MAX_RATIO:
            raise BundleError(f"refused: {plain(entry.filename)} would unpack to {ratio:.0f} times its size")


def _content(file: BinaryIO, entry: zipfile.ZipInfo) -> bytes:
    """Read the next entry and refuse whatever ``zipfile`` skips, since no checksum would cover it."""
    name, header = plain(entry.filename), entry.FileHeader()
    if entry.header_offset != file.tell() or file.read(len(header)) != header:
        raise BundleError(f"refused: what stands in front of {name} is not its header alone")
    content = packed = file.read(entry.compress_size)
    if entry.compress_type == zipfile.ZIP_DEFLATED:
        inflater = zlib.decompressobj(-zlib.MAX_WBITS)
        content = inflater.decompress(packed, entry.file_size + 1)
        if inflater.unused_data:
            raise BundleError(f"refused: {name} holds bytes behind its content")
    elif entry.compress_type != zipfile.ZIP_STORED:
        raise BundleError(f"refused: {name} is neither stored nor deflated")
    if len(content) != entry.file_size or zlib.crc32(content) != entry.CRC:
        raise BundleError(f"refused: {name} does not unpack to what it claims")
    return content


def _check_name(name: str) -> None:
    """Refuse every name that could mean another place on some system."""
    path = PurePosixPath(name)
    elsewhere = path.is_absolute() or ".." in path.parts or name != str(path)
    odd = any(ord(character) < 32 or ord(character) == 127 or character in "\\:" for character in name)
    if not name or len(name) > MAX_NAME or elsewhere or odd:
        raise BundleError(f"refused: a file named '{plain(name)}'")
