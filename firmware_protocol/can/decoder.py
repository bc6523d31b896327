"""Frames of a CAN bus in, packets out: the way every host reads a bus."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.counters import CanCounters
from firmware_protocol.can.few_samples import MAX_QUICK_BYTES, plain_samples, whole_samples
from firmware_protocol.can.frames import CLASSIC_BYTES, CanFrame, FrameArray, FrameFlag, frame_array
from firmware_protocol.can.mapping import (
    FD_BIT,
    FUNCTIONS,
    HOST_FUNCTIONS,
    MAX_NODE,
    MIN_NODE,
    NODE_BITS,
    NODE_MASK,
    WHOLE_ORIENTATION_BYTES,
    CanFunction,
    arbitration_id,
)
from firmware_protocol.can.node_decoder import NodeDecoder
from firmware_protocol.errors import MalformedPacketError, PacketValueError
from firmware_protocol.items import StreamItem
from firmware_protocol.packets import OrientationBatch

_OURS = np.zeros(2048, np.bool_)
for _function in CanFunction:
    for _bit in (0, FD_BIT):
        _OURS[_bit | _function << NODE_BITS : (_bit | _function << NODE_BITS) + NODE_MASK + 1] = True
_NOT_DATA = int(FrameFlag.ERROR | FrameFlag.REMOTE | FrameFlag.EXTENDED | FrameFlag.SENT)


def _is_ours(records: FrameArray) -> npt.NDArray[np.bool_]:
    ids = records["arbitration_id"]
    good = ((records["flags"] & _NOT_DATA) == 0) & (ids < len(_OURS))
    return np.asarray(good & _OURS[np.minimum(ids, len(_OURS) - 1)])


class CanBusDecoder:
    """Turn the frames of one bus into packets, each node a stream of its own.

    ``feed`` never blocks and never raises on what was on the bus.

    Parameters
    ----------
    nodes : iterable of int
        Node ids to follow; empty follows every node that is heard.
    answers : bool
        Whether frames of our own may be sent (flow control); take them with :meth:`take_outgoing`.
    """

    def __init__(self, nodes: tuple[int, ...] = (), answers: bool = False) -> None:
        for node in nodes:
            if not MIN_NODE <= node <= MAX_NODE:
                raise PacketValueError(f"node id {node} is not from {MIN_NODE} to {MAX_NODE}")
        self._only = frozenset(nodes)
        self._answers = answers
        self.nodes: dict[int, NodeDecoder] = {node: NodeDecoder(node, answers) for node in nodes}
        """Decoders of the nodes followed."""
        self._heard: Counter[int] = Counter()
        self._bytes = 0
        self._error_frames = self._remote_frames = self._foreign_frames = self._other_node_frames = 0
        self._damaged_batches = 0

    @property
    def heard(self) -> dict[int, int]:
        """Frames from each node on the bus, followed or not."""
        return dict(self._heard)

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should be told, a sentence each."""
        return tuple(problem for decoder in self.nodes.values() for problem in decoder.problems)

    def counters(self, node: int) -> CanCounters:
        """Snapshot of one node's counters, with those of the bus."""
        own = self.nodes[node].counters if node in self.nodes else CanCounters()
        return dataclasses.replace(
            own,
            bytes=self._bytes,
            error_frames=self._error_frames,
            remote_frames=self._remote_frames,
            foreign_frames=self._foreign_frames,
            other_node_frames=self._other_node_frames,
            damaged_batches=self._damaged_batches,
        )

    def feed(self, data: bytes) -> dict[int, list[StreamItem]]:
        """Take one or more frame batches; return what they complete, by node and in wire order."""
        try:
            records = frame_array(data)
        except MalformedPacketError:
            self._damaged_batches += 1
            return {}
        return self.feed_array(records)

    def feed_array(self, records: FrameArray) -> dict[int, list[StreamItem]]:
        """Take frames as a structured array; see :meth:`feed`."""
        self._bytes += int(records["length"].sum())
        own = _is_ours(records)
        if not own.all():
            self._count_others(records[~own])
            records = records[own]
        node_ids = records["arbitration_id"] & NODE_MASK
        items: dict[int, list[StreamItem]] = {}
        for node in np.unique(node_ids).tolist() if len(node_ids) else ():
            mine = records if (node_ids == node).all() else records[node_ids == node]
            self._heard[node] += len(mine)
            if node == 0 or (self._only and node not in self._only):
                self._other_node_frames += len(mine)
                continue
            if node not in self.nodes:
                self.nodes[node] = NodeDecoder(node, self._answers)
            found = self.nodes[node].feed(mine)
            if found:
                items[node] = found
        return items

    def feed_next(self, node: int, frames: Sequence[tuple[int, int]]) -> OrientationBatch | None:
        """Take a few ORIENTATION frames of one node if they are plainly the next samples; else None."""
        decoder = self.nodes.get(node)
        batch = None if decoder is None else decoder.feed_next(frames)
        if batch is not None:
            self._bytes += CLASSIC_BYTES * len(frames)
            self._heard[node] += len(frames)
        return batch

    def feed_whole(self, node: int, batch: OrientationBatch) -> bool:
        """Take samples of CAN FD frames of one node, decoded already; False where they must go the long way."""
        decoder = self.nodes.get(node)
        if decoder is None or not decoder.feed_whole(batch):
            return False
        self._bytes += WHOLE_ORIENTATION_BYTES * len(batch)
        self._heard[node] += len(batch)
        return True

    def follow_only(self, node: int) -> None:
        """From now on, follow this node alone."""
        self._only = frozenset({node})

    def flush(self) -> dict[int, list[StreamItem]]:
        """Give away samples still held: the bus is over."""
        return {node: items for node, decoder in self.nodes.items() if (items := decoder.flush())}

    def take_outgoing(self) -> list[CanFrame]:
        """Return the flow control frames to be sent since the last call."""
        return [frame for decoder in self.nodes.values() for frame in decoder.take_outgoing()]

    def restart(self) -> None:
        """Begin anew after the link was cut; the counters go on."""
        for decoder in self.nodes.values():
            decoder.restart()

    def _count_others(self, records: FrameArray) -> None:
        flags = records["flags"]
        is_error = (flags & FrameFlag.ERROR) != 0
        is_remote = ~is_error & ((flags & FrameFlag.REMOTE) != 0)
        is_sent = ~is_error & ~is_remote & ((flags & FrameFlag.SENT) != 0)
        self._error_frames += int(is_error.sum())
        self._remote_frames += int(is_remote.sum())
        self._foreign_frames += len(records) - int((is_error | is_remote | is_sent).sum())


class CanStreamDecoder:
    """Turn the frames of one object into packets: the same interface as the serial ``StreamDecoder``.

    Parameters
    ----------
    node : int or None
        Node id; None takes the first object that is heard.
    answers : bool
        Whether flow control frames may be sent; take them with :meth:`take_outgoing`.
    """

    def __init__(self, node: int | None = None, answers: bool = False) -> None:
        self._node = node
        self._bus = CanBusDecoder(() if node is None else (node,), answers)

    @property
    def node(self) -> int | None:
        """The object followed; None while none has been heard."""
        return self._node

    @property
    def other_nodes(self) -> tuple[int, ...]:
        """Node ids of other objects on the bus."""
        return tuple(sorted(node for node in self._bus.heard if node not in (0, self._node)))

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should be told, a sentence each."""
        return self._bus.problems

    @property
    def counters(self) -> CanCounters:
        """Snapshot of the counters."""
        return self._bus.counters(self._node or 0)

    def feed(self, data: bytes) -> list[StreamItem]:
        """Take one or more frame batches; return what they complete, in wire order."""
        if self._node is None:
            self._choose(data)
        elif len(data) <= MAX_QUICK_BYTES:
            batch = self._feed_few(data, self._node)
            if batch is not None:
                return [batch]
        return self._bus.feed(data).get(self._node or 0, [])

    def _feed_few(self, data: bytes, node: int) -> OrientationBatch | None:
        """Take samples that nothing is unusual about; None, and nothing changed, where the batch is not that."""
        frames = plain_samples(data, arbitration_id(CanFunction.ORIENTATION, node))
        if frames is not None:
            return self._bus.feed_next(node, frames)
        batch = whole_samples(data, arbitration_id(CanFunction.ORIENTATION, node, True))
        return batch if batch is not None and self._bus.feed_whole(node, batch) else None

    def _choose(self, data: bytes) -> None:
        try:
            records = frame_array(data)
        except MalformedPacketError:
            return
        ids = records["arbitration_id"][_is_ours(records)]
        nodes = ids & NODE_MASK
        function = ids >> NODE_BITS & (FUNCTIONS - 1)
        objects = nodes[(nodes > 0) & ~np.isin(function, list(HOST_FUNCTIONS))]
        if len(objects):
            self._node = int(objects[0])
            self._bus.follow_only(self._node)

    def flush(self) -> list[StreamItem]:
        """Give away samples still held: the link is over."""
        return self._bus.flush().get(self._node or 0, [])

    def take_outgoing(self) -> list[CanFrame]:
        """Return the flow control frames to be sent since the last call."""
        return self._bus.take_outgoing()

    def take_damage(self) -> list[int]:
        """Tell where malformed samples came since the last call: how many were delivered before each, ascending."""
        decoder = self._bus.nodes.get(self._node or 0)
        return [] if decoder is None else decoder.take_damage()

    def restart(self) -> None:
        """Begin anew after the link was cut; the counters go on."""
        self._bus.restart()
