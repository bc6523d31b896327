"""Whether two files that were drawn show the same: figures as PNG, SVG and PDF, and samples as parquet.

Another processor computes the last digits otherwise, and then here a shade of one pixel and there the sixth decimal of
a coordinate differ, though nobody altered anything. So files whose bytes differ are compared by what is in them:
everything but numbers must be the same, and numbers may differ by less than can be seen. Whatever cannot be read is a
difference, never an exception.
"""

from __future__ import annotations

import functools
import importlib
import io
import math
import re
import struct
import zlib
from collections.abc import Callable
from pathlib import PurePosixPath
from typing import Any

import numpy as np

MAX_SHADE = 2
"""Largest difference of a pixel, of 255 shades."""
MAX_COORDINATE = 2e-5
"""Largest difference of a number in a drawing, points: they are written with six decimals."""
MAX_PIXELS = 1e-3
"""Share of the bytes of a picture inside a PDF that may differ: there a palette may be ordered otherwise."""
NUMBER = re.compile(r"-?\d+\.?\d*(?:[eE][-+]?\d+)?|-?\.\d+")
"""A number in a text."""
_MADE_ID = re.compile(r"\b([a-zA-Z]{1,6}?)([0-9a-f]{10})\b")  # matplotlib names clips and markers by their content
_IMAGE = re.compile(r'(data:image/png;base64,)([A-Za-z0-9+/=\s]+)(?=")')
_STREAM = re.compile(rb"stream\r?\n(.*?)\r?\nendstream", re.DOTALL)
_XREF = re.compile(rb"\nxref\n.*?(?=trailer)|\nstartxref\n\d+", re.DOTALL)
_SVG_TEXT = re.compile(r"<!--.*?-->", re.DOTALL)  # letters are drawn; what they say stands beside them
_PDF_TEXT = re.compile(r"\((?:\\.|[^()\\])*\)", re.DOTALL)
_LENGTH = re.compile(rb"(\d+ 0 obj\r?\n)\d+(\r?\nendobj)|/Length \d+\b(?! 0 R)")


class ComparisonUnavailableError(Exception):
    """The package that reads this kind of file is not installed; the message names it."""


def shows_the_same(name: str, claimed: bytes, made: bytes, *, same_library: bool = True) -> bool:
    """Compare two drawn files by content.

    Parameters
    ----------
    name : str
        Its ending says the kind.
    claimed : bytes
        The foreign file; nothing in it is trusted.
    made : bytes
        Our own.
    same_library : bool
        Whether the same version of pyarrow wrote both; then no byte of a parquet file may differ but for its values.

    Raises
    ------
    ComparisonUnavailableError
        A package that is needed to read this kind is not installed.
    """
    if claimed == made:
        return True
    kinds: dict[str, Callable[[bytes, bytes], bool]] = {
        ".png": _same_png,
        ".svg": _same_svg,
        ".pdf": _same_pdf,
        ".parquet": functools.partial(_same_parquet, same_library=same_library),
    }
    same = kinds.get(PurePosixPath(name).suffix)
    return same is not None and len(claimed) <= 2 * len(made) + 100_000 and same(claimed, made)


def _same_png(claimed: bytes, made: bytes) -> bool:
    ours, theirs = _chunks(made), _chunks(claimed)
    # Everything but the pixels must be equal, the size with it: so nothing larger than ours is ever unpacked.
    if ours is None or theirs is None or ours[0] != theirs[0]:
        return False
    width, height, depth, kind = struct.unpack(">IIBB", dict(ours[0])[b"IHDR"][:10])
    if depth != 8 or kind not in {2, 6}:
        return False
    pixels = [
        _pixels(part[1], width * (3 if kind == 2 else 4), height, 3 if kind == 2 else 4) for part in (ours, theirs)
    ]
    if pixels[0] is None or pixels[1] is None:
        return False
    return bool(np.abs(pixels[0].astype(np.int16) - pixels[1]).max(initial=0) <= MAX_SHADE)


def _chunks(data: bytes) -> tuple[list[tuple[bytes, bytes]], bytes] | None:
    """Split a PNG into its other chunks, in order, and the pixels' bytes; None where it is none."""
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        return None
    others, packed, place = [], [], 8
    while place + 12 <= len(data):
        (length,) = struct.unpack(">I", data[place : place + 4])
        kind, body = data[place + 4 : place + 8], data[place + 8 : place + 8 + length]
        crc = data[place + 8 + length : place + 12 + length]
        if len(body) != length or crc != struct.pack(">I", zlib.crc32(kind + body)):
            return None
        if kind == b"IDAT":
            packed.append(body)
        else:
            others.append((kind, body))
        place += 12 + length
    return None if place != len(data) or not others or others[0][0] != b"IHDR" else (others, b"".join(packed))


def _pixels(packed: bytes, row_bytes: int, height: int, channels: int) -> np.ndarray[Any, np.dtype[np.uint8]] | None:
    """Unpack and unfilter the rows of a PNG; None where they are damaged."""
    raw = _unpacked(packed, height * (row_bytes + 1))
    if raw is None or len(raw) != height * (row_bytes + 1):
        return None
    from PIL import Image, UnidentifiedImageError

    # Our own head before their rows: the decoder sees no other size than ours.
    head = struct.pack(">IIBBBBB", row_bytes // channels, height, 8, 2 if channels == 3 else 6, 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", zlib.compress(raw, 1)), (b"IEND", b"")]
    picture = b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in parts
    )
    try:
        return np.asarray(Image.open(io.BytesIO(picture)), dtype=np.uint8)
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError):
        return None


def _same_svg(claimed: bytes, made: bytes) -> bool:
    try:
        theirs, ours = claimed.decode("utf-8"), made.decode("utf-8")
    except UnicodeDecodeError:
        return False
    pictures = [_IMAGE.findall(text) for text in (theirs, ours)]
    if len(pictures[0]) != len(pictures[1]):
        return False
    for (_, one), (_, other) in zip(*pictures, strict=True):
        if one != other and not _same_png(_from_base64(one), _from_base64(other)):
            return False
    return _same_text(_named_in_order(_IMAGE.sub(r"\1", theirs)), _named_in_order(_IMAGE.sub(r"\1", ours)), _SVG_TEXT)


def _from_base64(text: str) -> bytes:
    import base64

    try:
        return base64.b64decode("".join(text.split()), validate=True)
    except ValueError:
        return b""


def _named_in_order(text: str) -> str:
    """Replace names made of a checksum by the order in which they appear."""
    names: dict[str, str] = {}
    return _MADE_ID.sub(lambda m: names.setdefault(m[0], f"{m[1]}_{len(names)}_"), text)


def _same_text(claimed: str, made: str, exact: re.Pattern[str]) -> bool:
    """Whether two drawings differ in nothing but coordinates, and these by little; what can be read must be equal."""
    if claimed == made:
        return True
    if exact.findall(claimed) != exact.findall(made) or NUMBER.sub("#", claimed) != NUMBER.sub("#", made):
        return False
    pairs = zip(NUMBER.findall(claimed), NUMBER.findall(made), strict=True)
    return all(one == other or math.isclose(float(one), float(other), abs_tol=MAX_COORDINATE) for one, other in pairs)


def _same_pdf(claimed: bytes, made: bytes) -> bool:
    theirs, ours = _STREAM.split(claimed), _STREAM.split(made)
    if len(theirs) != len(ours):
        return False
    for place, (one, other) in enumerate(zip(theirs, ours, strict=True)):
        if place % 2 == 0:
            same = _same_skeleton(one, other)
        else:
            picture = b"/Image" in ours[place - 1].rpartition(b" obj")[2]
            same = _same_stream(one, other, picture=picture)
        if not same:
            return False
    return True


def _same_skeleton(claimed: bytes, made: bytes) -> bool:
    # Lengths of packed streams, and so the places of all objects, follow from the packing.
    theirs, ours = (_LENGTH.sub(rb"\1\2", _XREF.sub(b"", part)) for part in (claimed, made))
    return theirs == ours or _same_text(theirs.decode("latin-1"), ours.decode("latin-1"), _PDF_TEXT)


def _same_stream(claimed: bytes, made: bytes, *, picture: bool) -> bool:
    if claimed == made:
        return True
    ours = _unpacked(made, 2**28)
    theirs = None if ours is None else _unpacked(claimed, len(ours) + 10_000)
    if ours is None or theirs is None:
        return False
    if not picture:
        return _same_text(theirs.decode("latin-1"), ours.decode("latin-1"), _PDF_TEXT)
    if len(ours) != len(theirs):
        return False
    return float(np.mean(np.frombuffer(ours, np.uint8) != np.frombuffer(theirs, np.uint8))) <= MAX_PIXELS


def _unpacked(packed: bytes, most: int) -> bytes | None:
    """Inflate at most so much; None where it is damaged, longer, or something follows."""
    try:
        unpacker = zlib.decompressobj()
        raw = unpacker.decompress(packed, most + 1)
    except zlib.error:
        return None
    return raw if unpacker.eof and not unpacker.unused_data and len(raw) <= most else None


def _same_parquet(claimed: bytes, made: bytes, *, same_library: bool) -> bool:
    try:
        tables: Any = importlib.import_module("pyarrow.parquet")
        lib: Any = importlib.import_module("pyarrow")
    except ImportError as error:
        raise ComparisonUnavailableError("pyarrow (pip install 'rotdrift[parquet]')") from error
    try:
        ours, theirs = tables.ParquetFile(io.BytesIO(made)), tables.ParquetFile(io.BytesIO(claimed))
        if not theirs.schema_arrow.equals(ours.schema_arrow, check_metadata=True):
            return False
        if theirs.metadata.num_rows != ours.metadata.num_rows:
            return False
        one, other = theirs.read(), ours.read()
        if same_library:
            # The same library writes the same table as the same bytes: whatever else stands in the file was put there.
            again = io.BytesIO()
            tables.write_table(one, again, compression="zstd")
            if again.getvalue() != claimed:
                return False
        pairs = [(one[name].to_numpy(), other[name].to_numpy()) for name in other.column_names]
        return all(
            np.array_equal(*pair) if pair[1].dtype.kind == "i" else np.allclose(*pair, rtol=1e-14, atol=1e-9)
            for pair in pairs
        )
    except (lib.ArrowException, OSError, ValueError, TypeError):
        return False
