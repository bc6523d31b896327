"""The zip of a submission: the same content gives the same bytes, and only these bytes are read.

An archive is a row of files in the order of their names, each a header and its deflated content; then a directory, then
22 bytes that state where the directory begins. Nothing stands in front, between or behind, and all headers follow from
names, sizes and CRCs. So the reader needs no search: it walks from the first byte, writes each header again and
compares it with what stands there, and the same for directory and end. What zip readers skip or choose between
(comments, extra fields, a second directory, a local header that contradicts the directory) cannot be there.

The one freedom left is how a content is deflated: other releases of zlib pack it otherwise. :func:`archive_bytes` of
what was read shows whether it is packed as it would be here.

Limits hold before anything is unpacked, and nothing is written to disk.
"""

from __future__ import annotations

import stat
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath

from host.text import plain

MAX_ENTRIES = 20_000
MAX_FILE_BYTES = 2**30
MAX_TOTAL_BYTES = 2 * 2**30
"""Also of the archive itself: it holds no more than its content, but for what deflate adds to noise."""
MAX_RATIO = 200
"""Deflate reaches 1032 at most, and only on nothing but zeros; a recording reaches 3, a CSV 5, a blank SVG some 20."""
RATIO_FREE_BYTES = 10 * 2**20
"""Below this size no ratio is suspicious."""
MAX_NAME = 240

DEFLATE_LEVEL = 6
_VERSION = 20
"""Of the format, 2.0: the first with deflate and folders."""
_UNIX = 3
_DEFLATED = 8
_NO_TIME, _FIRST_DAY = 0, 1 << 5 | 1
"""1980-01-01, the earliest date a zip can hold: every file has it."""
_PLAIN_FILE = (stat.S_IFREG | 0o644) << 16

_LOCAL = struct.Struct("<4s5H3I2H")
"""Signature, version, flags, method, time, date, CRC, packed size, size, length of the name, of extra fields."""
_DIRECTORY = struct.Struct("<4s2B5H3I5H2I")
"""Signature, version and system of the writer, then as above; length of a comment, disk, attributes, offset."""
_END = struct.Struct("<4s4H2IH")
"""Signature, two disks, two numbers of files, size and offset of the directory, length of a comment."""
_LOCAL_SIGNATURE, _DIRECTORY_SIGNATURE, _END_SIGNATURE = b"PK\3\4", b"PK\1\2", b"PK\5\6"


class BundleError(Exception):
    """A bundle that is refused or cannot be read: not a zip, hostile, damaged, not ours; one sentence names why."""


@dataclass(frozen=True)
class _Member:
    """What decides both headers of a file."""

    name: str
    crc: int
    packed_size: int
    size: int

    @property
    def _common(self) -> tuple[int, ...]:
        return (
            _VERSION, 0, _DEFLATED, _NO_TIME, _FIRST_DAY, self.crc, self.packed_size, self.size, len(self.name), 0
        )  # fmt: skip

    def local_header(self) -> bytes:
        """Return what stands in front of its content."""
        return _LOCAL.pack(_LOCAL_SIGNATURE, *self._common) + self.name.encode("ascii")

    def directory_entry(self, offset: int) -> bytes:
        """Return its entry in the directory; ``offset`` is that of its header."""
        fixed = _DIRECTORY.pack(
            _DIRECTORY_SIGNATURE, _VERSION, _UNIX, *self._common, 0, 0, 0, _PLAIN_FILE, offset
        )  # fmt: skip
        return fixed + self.name.encode("ascii")


def archive_bytes(files: Mapping[str, bytes]) -> bytes:
    """Return the zip of files by name (forward slashes).

    Raises
    ------
    BundleError
        A name, a size or a number of files that a reader would refuse.
    """
    pieces: list[bytes] = []
    members: dict[int, _Member] = {}
    offset = total = 0
    for name in sorted(files):
        check_name(name)
        packed = _deflated(files[name])
        member = _Member(name, zlib.crc32(files[name]), len(packed), len(files[name]))
        total += member.size
        _check_size(member, max(total, offset + member.packed_size), len(members) + 1)
        members[offset] = member
        pieces += [member.local_header(), packed]
        offset += len(pieces[-2]) + len(packed)
    return b"".join([*pieces, _tail(members, offset)])


def read_archive(data: bytes) -> dict[str, bytes]:
    """Return every file of an archive by name, unpacked within limits.

    Raises
    ------
    BundleError
        Not a zip, damaged, or not exactly as :func:`archive_bytes` writes it; one sentence names what.
    """
    if len(data) > MAX_TOTAL_BYTES:
        raise BundleError(f"refused: an archive of {len(data)} bytes, more than {MAX_TOTAL_BYTES}")
    if not data.startswith(_LOCAL_SIGNATURE):
        raise BundleError("refused: it is not a zip, or something stands in front of its first file")
    view = memoryview(data)
    files: dict[str, bytes] = {}
    members: dict[int, _Member] = {}
    offset = total = 0
    while view[offset : offset + 4] == _LOCAL_SIGNATURE:
        member = _member_at(view, offset)
        _check_order(member.name, files)
        total += member.size
        _check_size(member, total, len(files) + 1)
        members[offset] = member
        offset += _LOCAL.size + len(member.name)
        files[member.name] = _inflated(view[offset : offset + member.packed_size], member)
        offset += member.packed_size
    _check_twins(files)
    if view[offset:] != _tail(members, offset):
        raise BundleError(
            "refused: behind the files stands something other than their directory, or it contradicts them"
        )
    return files


def check_name(name: str) -> None:
    """Refuse every name that could mean another place, or another name, on some system; raises BundleError."""
    path = PurePosixPath(name)
    elsewhere = path.is_absolute() or ".." in path.parts or name != str(path)
    odd = not (name.isascii() and name.isprintable()) or any(character in "\\:" for character in name)
    if not name or len(name) > MAX_NAME or elsewhere or odd:
        raise BundleError(f"refused: a file named '{plain(name)}'")


def _tail(members: Mapping[int, _Member], offset: int) -> bytes:
    """Return what stands behind the files, which end at ``offset``: the directory and its end."""
    directory = b"".join(member.directory_entry(at) for at, member in members.items())
    return directory + _END.pack(_END_SIGNATURE, 0, 0, len(members), len(members), len(directory), offset, 0)


def _member_at(view: memoryview, offset: int) -> _Member:
    """Return the file whose header stands here; the header must be what the file gives, to the last byte."""
    if len(view) < offset + _LOCAL.size:
        raise BundleError("refused: the archive ends in a header")
    _, _, flags, method, _, _, crc, packed_size, size, name_length, _ = _LOCAL.unpack_from(view, offset)
    start = offset + _LOCAL.size
    name = bytes(view[start : start + min(name_length, MAX_NAME + 1)]).decode("ascii", "replace")
    check_name(name)
    if flags & 1:
        raise BundleError(f"refused: {name} is encrypted")
    if method != _DEFLATED:
        raise BundleError(f"refused: {name} is not deflated")
    member = _Member(name, crc, packed_size, size)
    header = member.local_header()
    if view[offset : offset + len(header)] != header:
        raise BundleError(f"refused: the header of {name} is not as rotdrift writes it")
    return member


def _check_order(name: str, before: dict[str, bytes]) -> None:
    last = next(reversed(before), "")
    if name == last:
        raise BundleError(f"refused: {name} is there twice")
    if name < last:
        raise BundleError(f"refused: {name} stands behind {last}: the files are not in the order of their names")


def _check_size(member: _Member, total: int, count: int) -> None:
    """Refuse what claims to be too large, before it is unpacked."""
    if count > MAX_ENTRIES:
        raise BundleError(f"refused: more than {MAX_ENTRIES} files")
    if member.size > MAX_FILE_BYTES or total > MAX_TOTAL_BYTES:
        raise BundleError(f"refused: {member.name} claims {member.size} bytes, {total} in all so far")
    ratio = member.size / max(member.packed_size, 1)
    if member.size > RATIO_FREE_BYTES and ratio > MAX_RATIO:
        raise BundleError(f"refused: {member.name} would unpack to {ratio:.0f} times its size")


def _check_twins(files: Mapping[str, bytes]) -> None:
    """Refuse names that are one name where case does not count."""
    seen: set[str] = set()
    for name in files:
        if name.lower() in seen:
            raise BundleError(f"refused: {name} is there twice, but for its case")
        seen.add(name.lower())


def _deflated(content: bytes) -> bytes:
    deflater = zlib.compressobj(DEFLATE_LEVEL, zlib.DEFLATED, -zlib.MAX_WBITS)
    return deflater.compress(content) + deflater.flush()


def _inflated(packed: memoryview, member: _Member) -> bytes:
    """Return the content of a file: never more than it claims, from exactly the bytes that it claims."""
    inflater = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        content = inflater.decompress(packed, member.size + 1)
    except zlib.error as error:
        raise BundleError(f"refused: {member.name} cannot be unpacked ({error})") from error
    if not inflater.eof or len(content) != member.size or zlib.crc32(content) != member.crc:
        raise BundleError(f"refused: {member.name} does not unpack to what it claims")
    if inflater.unused_data:
        raise BundleError(f"refused: {member.name} holds bytes behind its content")
    return content
