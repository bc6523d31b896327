"""Which boot of an object frames are of: by boot tags, and by sample counters that fall."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.frames import FrameArray
from firmware_protocol.can.mapping import COUNTER_MODULUS, CanFunction
from firmware_protocol.can.numbering import LATE_WINDOW


class Boots:
    """Follows the boot tags in SAMPLE_STATE and the counters in SAMPLE_STATE and TIME of one node id."""

    def __init__(self) -> None:
        self._tag = 0
        self._old_tags: set[int] = set()
        self._n_returned = 0

    @property
    def in_conflict(self) -> bool:
        """Whether two objects with this node id are on the bus: their boot tags come back in turn."""
        return self._n_returned >= 2

    def are_known(self, states: npt.NDArray[np.uint64]) -> bool:
        """Return whether SAMPLE_STATE frames, as u64, are all of the present boot, or carry no boot tag."""
        tags = states >> np.uint64(56)
        return bool(((tags == 0) | (tags == self._tag)).all())

    def starts(self, function: npt.NDArray[Any], records: FrameArray, expected: int | None) -> list[int]:
        """Return the rows at which the object has started again.

        Parameters
        ----------
        function : (n,)
            Bits 5-10 of the arbitration ids.
        records : (n,)
            Frames of the object.
        expected : int or None
            Counter of the next sample; None where no frame has shown it.
        """
        rows = np.flatnonzero((function == int(CanFunction.TIME)) | (function == int(CanFunction.SAMPLE_STATE)))
        if len(rows) == 0:
            return []
        codes = records["code"][rows]
        counters = codes.astype(np.uint32)
        before = counters[:1] if expected is None else np.array([expected % COUNTER_MODULUS], np.uint32)
        falls = np.diff(np.concatenate([before, counters])).view(np.int32) < -LATE_WINDOW
        tags = (codes >> np.uint64(56)).astype(np.uint8)
        tags[function[rows] == int(CanFunction.TIME)] = 0  # those bits are device time
        if not (falls.any() or ((tags != 0) & (tags != self._tag)).any()):
            return []
        starts = []
        for row, fell, tag in zip(rows.tolist(), falls.tolist(), tags.tolist(), strict=True):
            if self._is_new(tag) or fell:
                starts.append(row)
        return starts

    def _is_new(self, tag: int) -> bool:
        """Follow one boot tag; return whether it replaces another. 0 means that the object has none."""
        if tag in (0, self._tag):
            return False
        had_tag = self._tag != 0
        self._n_returned += tag in self._old_tags
        self._old_tags.add(self._tag)
        self._tag = tag
        return had_tag
