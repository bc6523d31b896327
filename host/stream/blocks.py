"""Samples in order of the wire, as the assembler gives them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SampleBlock:
    """n samples of one segment in wire order; none of them was here before."""

    segment: int
    """0, and one more after each reset of the device or step of its clock."""
    sequence: IntArray
    """(n,) unwrapped number within the segment."""
    index: IntArray
    """(n,) number within the whole capture: segments follow each other."""
    time_s: FloatArray
    """(n,) device time since the first sample of the capture, s."""
    quats_wxyz: FloatArray
    """(n, 4) unit quaternions, body to world."""
    flags: npt.NDArray[np.uint8]
    """(n,) bits of :class:`firmware_protocol.packets.OrientationFlag`."""
    host_time_ns: int
    """Reception of the chunk, monotonic."""

    def __len__(self) -> int:
        return len(self.sequence)


@dataclass(frozen=True, slots=True)
class SegmentStart:
    """Where a segment begins."""

    segment: int
    time_s: float
    """On the time axis of the capture."""
    host_time_ns: int
    reason: str
    """For people."""


def selected(block: SampleBlock, keep: npt.NDArray[np.bool_]) -> SampleBlock:
    """Return some of a block's samples: those where ``keep`` (n,) is True."""
    return SampleBlock(
        segment=block.segment,
        sequence=block.sequence[keep],
        index=block.index[keep],
        time_s=block.time_s[keep],
        quats_wxyz=block.quats_wxyz[keep],
        flags=block.flags[keep],
        host_time_ns=block.host_time_ns,
    )
