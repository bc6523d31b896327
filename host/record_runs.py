"""Finding the message records of a block of MCAP at once: what lets an hour be read in a second.

Records are a linked list, and walking it one by one is most of the work of reading a recording. Here every place that
can be the start of a message is found with numpy, with where it would end; where one ends at the next such place the
two are linked. From a place known to be a start, all linked ones after it are starts as well. A false start (data that
looks like one) only breaks a run in two: it is never reached, because no record before it ends there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

IntArray = npt.NDArray[np.int64]

LONGEST_BYTES = 2**24
"""A longer message is none of ours, nor a viewer's: it is left to the walk record by record."""
HEAD_BYTES = 9
"""Kind u8, length u64."""
MESSAGE_HEAD_BYTES = 22
"""Channel u16, sequence u32, log time u64, publish time u64."""


@dataclass(frozen=True, slots=True, eq=False)
class MessageRun:
    """Message records that follow each other without a gap."""

    starts: IntArray
    """(n,) offset of each record's first byte."""
    ends: IntArray
    """(n,) offset behind each record."""
    channels: IntArray
    """(n,) channel ids."""

    def chosen(self, which: npt.NDArray[np.bool_] | slice) -> Iterator[tuple[int, int, int]]:
        """Give channel, start and end of some of them, one by one."""
        columns = (self.channels[which], self.starts[which], self.ends[which])
        return zip(*(column.tolist() for column in columns), strict=True)


def _numbers(block: memoryview, dtype: str, offset: int) -> npt.NDArray[np.unsignedinteger]:
    """See a block as numbers that begin at every byte from ``offset`` on."""
    n = len(block) - offset - np.dtype(dtype).itemsize + 1
    return np.ndarray((max(n, 0),), dtype, block, offset if n > 0 else 0, strides=(1,))


class RecordRuns:
    """The runs of message records in one block.

    Parameters
    ----------
    block : buffer
        Bytes of a file; where in it a record starts is for the caller to know.
    """

    def __init__(self, block: memoryview) -> None:
        data = np.frombuffer(block, np.uint8)
        starts = np.flatnonzero(data[: max(len(data) - HEAD_BYTES - MESSAGE_HEAD_BYTES + 1, 0)] == Opcode.MESSAGE)
        lengths = _numbers(block, "<u8", 1)[starts].astype(np.int64)  # impossible ones come out negative, or too long
        ends = starts + HEAD_BYTES + lengths
        whole = (lengths >= MESSAGE_HEAD_BYTES) & (lengths < LONGEST_BYTES) & (ends <= len(data))
        self._starts, self._ends = starts[whole], ends[whole]
        self._channels = _numbers(block, "<u2", HEAD_BYTES)[self._starts].astype(np.int64)
        linked = self._starts[1:] == self._ends[:-1]
        self._breaks = np.append(np.flatnonzero(~linked), len(self._starts) - 1)

    def at(self, offset: int) -> MessageRun | None:
        """Return the run that begins with the record at an offset; None where that is no whole message."""
        first = int(np.searchsorted(self._starts, offset))
        if first == len(self._starts) or self._starts[first] != offset:
            return None
        last = int(self._breaks[np.searchsorted(self._breaks, first)]) + 1
        return MessageRun(self._starts[first:last], self._ends[first:last], self._channels[first:last])
