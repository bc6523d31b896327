"""ROS 2 messages without ROS: flat message types, their definition text, and their CDR bytes.

CDR (OMG, XCDR1, little endian): every number is aligned to its own size, counted from behind the four header bytes; a
string is its length with the closing zero, its UTF-8 bytes, and that zero.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

CDR_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
CRC_FIELD = "crc32"
"""A last field of this name, ``uint32``, is filled in and checked here: CRC-32 (zlib) of the type's name in UTF-8 and
all bytes of the message before the field."""
_CODES = {
    "bool": "?",
    "uint8": "B",
    "uint16": "H",
    "uint32": "I",
    "uint64": "Q",
    "int32": "i",
    "int64": "q",
    "float32": "f",
    "float64": "d",
}


@dataclass(frozen=True, slots=True)
class RosField:
    """One field of a message."""

    kind: str
    """A number type of ROS, such a type with ``[3]`` or ``[4]`` behind, or ``string``."""
    name: str
    comment: str = ""
    """Unit and meaning."""


@dataclass(frozen=True, slots=True)
class RosMessageType:
    """A flat message type.

    Examples
    --------
    >>> kind = RosMessageType("a/msg/B", (RosField("uint8", "n"), RosField("string", "text")))
    >>> kind.decode(kind.encode({"n": 3, "text": "é"}))
    {'n': 3, 'text': 'é'}
    """

    name: str
    """``package/msg/Type``."""
    fields: tuple[RosField, ...]

    @property
    def definition(self) -> bytes:
        """The text of the ``.msg`` file."""
        lines = [f"{item.kind} {item.name}" + (f"  # {item.comment}" if item.comment else "") for item in self.fields]
        return ("\n".join(lines) + "\n").encode()

    def encode(self, values: Mapping[str, Any]) -> bytes:
        """Make the CDR bytes; a missing or None number is NaN or 0, a missing text is empty."""
        out = bytearray()
        for item in self.fields:
            value = values.get(item.name)
            if item.kind == "string":
                text = str("" if value is None else value).encode("utf-8", "replace").replace(b"\0", b"")
                _pack(out, "I", len(text) + 1)
                out += text + b"\0"
                continue
            code, count = _code(item.kind)
            if item.name == CRC_FIELD:
                out += bytes(-len(out) % 4)
                value = self._crc(bytes(out))
            parts = list(value) if count > 1 and value is not None else [value] * count
            for part in parts:
                empty = float("nan") if code in "fd" else 0
                _pack(out, code, empty if part is None else part)
        return CDR_LITTLE_ENDIAN + bytes(out)

    def decode(self, message: bytes) -> dict[str, Any]:
        """Read CDR bytes back.

        Raises
        ------
        ValueError
            Not the bytes of such a message, or damaged.
        """
        if message[:4] != CDR_LITTLE_ENDIAN:
            raise ValueError("not little-endian CDR")
        body, at = message[4:], 0
        values: dict[str, Any] = {}
        try:
            for item in self.fields:
                if item.kind == "string":
                    length, at = _unpack(body, at, "I")
                    values[item.name] = body[at : at + length - 1].decode()
                    at += length
                    continue
                code, count = _code(item.kind)
                before = body[: at + -at % 4]
                parts = []
                for _ in range(count):
                    part, at = _unpack(body, at, code)
                    parts.append(part)
                values[item.name] = parts if count > 1 else parts[0]
                if item.name == CRC_FIELD and values.pop(CRC_FIELD) != self._crc(before):
                    raise ValueError("its CRC does not fit")
        except struct.error as error:
            raise ValueError(f"too short for {self.name}") from error
        return values

    def _crc(self, body: bytes) -> int:
        return zlib.crc32(body, zlib.crc32(self.name.encode()))


def _code(kind: str) -> tuple[str, int]:
    base, _, count = kind.rstrip("]").partition("[")
    return _CODES[base], int(count or 1)


def _pack(out: bytearray, code: str, value: Any) -> None:  # noqa: ANN401 - a number, a bool
    size = struct.calcsize(code)
    out += bytes(-len(out) % size)
    out += struct.pack(f"<{code}", value)


def _unpack(body: bytes, at: int, code: str) -> tuple[Any, int]:
    size = struct.calcsize(code)
    at += -at % size
    return struct.unpack_from(f"<{code}", body, at)[0], at + size
