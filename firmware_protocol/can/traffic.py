"""The frames of one object among all those on its bus."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.frames import FrameArray, FrameFlag
from firmware_protocol.can.mapping import FD_BIT, FUNCTION_MASK, HOST_FUNCTIONS, NODE_BITS, NODE_MASK, CanFunction
from firmware_protocol.items import Tally

_OURS = np.zeros(2048, np.bool_)
for _function in CanFunction:
    for _bit in (0, FD_BIT):
        _OURS[_bit | _function << NODE_BITS : (_bit | _function << NODE_BITS) + NODE_MASK + 1] = True
_NOT_DATA = int(FrameFlag.ERROR | FrameFlag.REMOTE | FrameFlag.EXTENDED | FrameFlag.SENT)


class Traffic:
    """Picks out the frames of one object (the first that is heard, where the node id is None), counts the others."""

    def __init__(self, node: int | None, tally: Tally) -> None:
        self.node = node
        """The object followed; None while none has been heard."""
        self._tally = tally

    def rows_of_own(self, records: FrameArray) -> npt.NDArray[np.intp]:
        """Return which frames :meth:`own` would return, counting nothing; none where the object is not known yet."""
        own = (records["arbitration_id"] & NODE_MASK) == (self.node or NODE_MASK + 1)
        return np.flatnonzero(own & _is_ours(records))

    def own(self, records: FrameArray) -> FrameArray:
        """Return the data frames of the object, those from a host to it among them."""
        self._tally["bytes"] += int(records["length"].sum())
        ours = _is_ours(records)
        if not ours.all():
            self._count_strangers(records[~ours])
            records = records[ours]
        if self.node is None:
            self.node = _first_object(records)
        own = (records["arbitration_id"] & NODE_MASK) == (self.node or NODE_MASK + 1)
        if not own.all():
            self._tally["other_node_frames"] += int(len(own) - own.sum())
            records = records[own]
        return records

    def _count_strangers(self, records: FrameArray) -> None:
        flags = records["flags"]
        is_error = (flags & FrameFlag.ERROR) != 0
        is_remote = ~is_error & ((flags & FrameFlag.REMOTE) != 0)
        is_sent = ~is_error & ~is_remote & ((flags & FrameFlag.SENT) != 0)
        self._tally.update(
            error_frames=int(is_error.sum()),
            remote_frames=int(is_remote.sum()),
            foreign_frames=len(records) - int((is_error | is_remote | is_sent).sum()),
        )


def _is_ours(records: FrameArray) -> npt.NDArray[np.bool_]:
    ids = records["arbitration_id"]
    good = ((records["flags"] & _NOT_DATA) == 0) & (ids < len(_OURS))
    return np.asarray(good & _OURS[np.minimum(ids, len(_OURS) - 1)])


def _first_object(records: FrameArray) -> int | None:
    """Return the node id of the first frame that an object sent."""
    ids = records["arbitration_id"]
    nodes = ids & NODE_MASK
    objects = nodes[(nodes > 0) & ~np.isin(ids >> NODE_BITS & FUNCTION_MASK, list(HOST_FUNCTIONS))]
    return int(objects[0]) if len(objects) else None
