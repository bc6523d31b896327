"""Readers that leave the parsing to a library, run in a process of their own (:mod:`analysis.confined`)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec

from analysis.confined.call import StoppedError, pieces_of
from analysis.confined.limits import Limits
from analysis.confined.values import from_pieces, to_pieces
from analysis.formats.columns import ColumnSpec
from analysis.formats.parquet import read_parquet
from analysis.formats.ros_bag import read_ros_bag
from analysis.formats.rows.streams import StreamChoice
from analysis.formats.source import SourceFile, plain
from analysis.formats.time_stamps import RawSamples
from analysis.series import ReaderError


def read_bag_apart(source: SourceFile, topic: str | None, choice: StreamChoice) -> RawSamples:
    """Read a bag or an MCAP file as :func:`read_ros_bag`, in a process of its own."""
    return _read("bag_pieces", source, topic, choice)


def read_parquet_apart(source: SourceFile, spec: ColumnSpec | None, choice: StreamChoice) -> RawSamples:
    """Read a parquet file as :func:`read_parquet`, in a process of its own."""
    return _read("parquet_pieces", source, msgspec.to_builtins(spec), choice)


def _read(function: str, source: SourceFile, argument: object, choice: StreamChoice) -> RawSamples:
    limits = Limits.of_file(source.n_bytes)
    arguments = str(source.path), argument, msgspec.to_builtins(choice)
    try:
        return from_pieces(pieces_of(f"{__name__}:{function}", *arguments, limits=limits), RawSamples)
    except StoppedError as error:
        raise ReaderError(
            f"{source.name} could not be read: {plain(str(error), 200)}; copy it again, cut it into trials, or save it "
            "as CSV"
        ) from error


def bag_pieces(path: str, topic: str | None, choice: object) -> Iterator[memoryview | bytes]:
    """Yield the pieces of :func:`read_bag_apart`; called in its process."""
    with SourceFile(Path(path)) as source:
        yield from to_pieces(read_ros_bag(source, topic, msgspec.convert(choice, StreamChoice)))


def parquet_pieces(path: str, spec: object, choice: object) -> Iterator[memoryview | bytes]:
    """Yield the pieces of :func:`read_parquet_apart`; called in its process."""
    with SourceFile(Path(path)) as source:
        columns = msgspec.convert(spec, ColumnSpec | None)
        yield from to_pieces(read_parquet(source, columns, msgspec.convert(choice, StreamChoice)))
