"""Samples in order of the wire, as the assembler returns and publishes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]
FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class SampleBlock:
    """n samples of one segment in wire order; none of them was here before."""

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
        return len(self.index)

    def chosen(self, keep: npt.NDArray[np.bool_]) -> SampleBlock:
        """Return some of the samples: those where ``keep`` (n,) is True."""
        return SampleBlock(
            index=self.index[keep],
            time_s=self.time_s[keep],
            quats_wxyz=self.quats_wxyz[keep],
            flags=self.flags[keep],
            host_time_ns=self.host_time_ns,
        )


def joined(blocks: Sequence[SampleBlock]) -> SampleBlock:
    """Return one or more blocks in order as one, received with the last."""
    if len(blocks) == 1:
        return blocks[0]
    return SampleBlock(
        index=np.concatenate([block.index for block in blocks]),
        time_s=np.concatenate([block.time_s for block in blocks]),
        quats_wxyz=np.concatenate([block.quats_wxyz for block in blocks]),
        flags=np.concatenate([block.flags for block in blocks]),
        host_time_ns=blocks[-1].host_time_ns,
    )


@dataclass(frozen=True, slots=True, eq=False)
class UnwrappedSamples:
    """n samples of one segment in wire order, repeated ones among them, on the unwrapped device clock."""

    first: int
    """How many samples of any kind came before the first of them."""
    device_time_us: IntArray
    """(n,) us; compares within one segment."""
    quats_wxyz: FloatArray
    """(n, 4) unit quaternions, body to world."""
    host_time_ns: int
    """Reception of the chunk (of many chunks, the last), monotonic."""


RESET = "the object was reset"
STEPPED = "the device clock stepped"
RESTARTED = "the device clock began anew"


@dataclass(frozen=True, slots=True)
class SegmentStart:
    """Where a segment starts."""

    segment: int
    time_s: float
    """On the time axis of the capture."""
    host_time_ns: int
    reason: str
    """For people: :data:`RESET`, :data:`STEPPED`, :data:`RESTARTED`, or of the first, that the capture began."""
