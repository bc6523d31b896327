"""A dataclass of texts, numbers and arrays as pieces of bytes, and back; unlike a pickle, they cannot run anything."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypeVar

import msgspec
import numpy as np
import numpy.typing as npt

Value = TypeVar("Value")


class _Array(msgspec.Struct, frozen=True):
    """What stands for an array: its bytes are the piece of that number."""

    piece: int
    dtype: str
    shape: tuple[int, ...]


def to_pieces(value: object) -> Iterator[memoryview | bytes]:
    """Turn a dataclass into pieces: JSON, and then the bytes of each array in it.

    Yields
    ------
    bytes
        One piece.
    """
    arrays: list[npt.NDArray[np.generic]] = []

    def placed(item: object) -> _Array:
        if not isinstance(item, np.ndarray):
            raise NotImplementedError(type(item).__name__)
        if item.dtype.hasobject:
            raise NotImplementedError(f"an array of {item.dtype}")
        arrays.append(np.ascontiguousarray(item))
        return _Array(len(arrays) - 1, item.dtype.str, item.shape)

    yield msgspec.json.encode(value, enc_hook=placed)
    for array in arrays:
        yield array.reshape(-1).view(np.uint8).data if array.nbytes else b""


def from_pieces(pieces: Iterable[bytearray], kind: type[Value]) -> Value:
    """Return the dataclass whose pieces :func:`to_pieces` yielded.

    Raises
    ------
    ValueError
        The pieces are of something else.
    """
    head, *contents = pieces

    def taken(_kind: object, item: object) -> npt.NDArray[np.generic]:
        array = msgspec.convert(item, _Array)
        dtype = np.dtype(array.dtype)
        if not dtype.itemsize or not contents[array.piece]:  # which frombuffer refuses
            return np.zeros(array.shape, dtype)
        return np.frombuffer(contents[array.piece], dtype).reshape(array.shape)

    return msgspec.json.decode(head, type=kind, dec_hook=taken)
