"""Frames of a CAN bus in, packets out: the way every host reads an object on a bus.

:class:`CanStreamDecoder` follows one object. :mod:`~firmware_protocol.can.traffic` picks out its frames,
:mod:`~firmware_protocol.can.boots` cuts them where it started again, :mod:`~firmware_protocol.can.samples` decodes its
samples and :mod:`~firmware_protocol.can.rare_frames` everything else. Decoders only listen: flow control for long
packets is sent where the frames are received.
"""

from __future__ import annotations

import itertools
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.boots import Boots
from firmware_protocol.can.counters import CanCounters
from firmware_protocol.can.few_samples import MAX_FAST_BYTES, plain_samples, whole_samples
from firmware_protocol.can.frames import CLASSIC_BYTES, FrameArray, concatenate_frames, frame_array
from firmware_protocol.can.mapping import (
    EXACT_LENGTHS,
    FUNCTION_MASK,
    MAX_NODE,
    MIN_NODE,
    NODE_BITS,
    WHOLE,
    WHOLE_ORIENTATION_BYTES,
    CanFunction,
    arbitration_id,
)
from firmware_protocol.can.rare_frames import RareFrames
from firmware_protocol.can.samples import SAMPLE, STATE, TIME, WHOLE_SAMPLE, FoundSamples, SampleDecoder
from firmware_protocol.can.traffic import Traffic
from firmware_protocol.errors import MalformedPacketError, PacketValueError
from firmware_protocol.items import ForeignInfo, LocatedPackets, StreamItem, Tally, in_wire_order
from firmware_protocol.packets import OrientationBatch, Packet, PacketType

_ANY_LENGTH = 255
_LENGTHS = np.full(WHOLE, _ANY_LENGTH, np.uint8)
for _function, _length in EXACT_LENGTHS.items():
    _LENGTHS[_function] = _length


class CanStreamDecoder:
    """Turn the frames of one object into packets, in wire order: the counterpart of the serial ``StreamDecoder``.

    ``feed`` never blocks and never raises on what was on the bus.

    Parameters
    ----------
    node : int or None
        Node id, 1-31; None is for the first object that is heard.

    Raises
    ------
    PacketValueError
        There is no such node id.
    """

    def __init__(self, node: int | None = None) -> None:
        if node is not None and not MIN_NODE <= node <= MAX_NODE:
            raise PacketValueError(f"node id {node} is not from {MIN_NODE} to {MAX_NODE}")
        self._tally: Tally = Tally()
        self._traffic = Traffic(node, self._tally)
        self._boots = Boots()
        self._samples = SampleDecoder(self._tally)
        self._rare = RareFrames(self._tally)
        self._n_samples = 0
        self._damage: list[int] = []

    @property
    def node(self) -> int | None:
        """The object followed; None while none has been heard."""
        return self._traffic.node

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know, a sentence each."""
        if self._boots.in_conflict:
            return (f"two objects on the bus have node id {self.node}, so their samples cannot be told apart",)
        return ()

    @property
    def counters(self) -> CanCounters:
        """Snapshot of the counters."""
        packets = dict(self._rare.packets) | ({PacketType.ORIENTATION: self._n_samples} if self._n_samples else {})
        return CanCounters(**self._tally, packets=MappingProxyType(packets))

    def feed(self, data: bytes) -> list[StreamItem]:
        """Process one or more frame batches; return what they complete, in wire order."""
        if self.node is not None and len(data) <= MAX_FAST_BYTES:
            batch = self._feed_few(data, self.node)
            if batch is not None:
                return [batch]
        try:
            records = self._traffic.own(frame_array(data))
        except MalformedPacketError:
            self._tally["damaged_batches"] += 1
            return []
        return self._feed_frames(records) if len(records) else []

    def feed_located(self, data: bytes) -> LocatedPackets | None:
        """Process many frame batches put end to end; return what they complete, and with which frame each packet.

        None, and nothing is taken into account, where packets could depend on how many batches are fed at once: then
        :meth:`feed` them one by one.
        """
        try:
            records = frame_array(data)
        except MalformedPacketError:
            return None
        rows = self._traffic.rows_of_own(records)
        own = records[rows]
        function = own["arbitration_id"] >> NODE_BITS
        if self._boots.in_conflict or not _right_lengths(function, own).all():
            return None
        if not (self._boots.are_known(own["code"][function == STATE]) and self._samples.are_plain(function, own)):
            return None
        self._traffic.own(records)
        self._tally["frames"] += len(own)
        found, others = self._decode_located(function, own)
        ends = rows[found.rows].astype(np.int64)
        return LocatedPackets(found.batch, ends, [(place, packet, int(rows[row])) for place, packet, row in others])

    def flush(self) -> list[StreamItem]:
        """Return the samples still held, numbered as well as can be: no TIME frame will follow."""
        held = self._samples.take_held()
        return [] if held is None else self._decode(held["arbitration_id"] >> NODE_BITS, held, is_last=True)

    def take_damage(self) -> list[int]:
        """Return where unusable samples came since the last call: how many were delivered before each, ascending."""
        damage, self._damage = self._damage, []
        return damage

    def restart(self) -> None:
        """Start again after the link was cut; the counters go on."""
        held = self._samples.take_held()
        if held is not None:
            self._tally["unnumbered"] += len(held)
        self._samples = SampleDecoder(self._tally)
        self._rare.restart()

    def _feed_few(self, data: bytes, node: int) -> OrientationBatch | None:
        """Decode samples that nothing is unusual about; None, and nothing changed, where the batch is not that."""
        if self._samples.holds or self._boots.in_conflict:
            return None
        frames = plain_samples(data, arbitration_id(CanFunction.ORIENTATION, node))
        if frames is not None:
            batch, size = self._samples.next(frames), CLASSIC_BYTES
        else:
            batch = whole_samples(data, arbitration_id(CanFunction.ORIENTATION, node, True))
            size = WHOLE_ORIENTATION_BYTES
        if batch is not None:
            self._tally["bytes"] += size * len(batch)
            self._tally["frames"] += len(batch)
            self._n_samples += len(batch)
        return batch

    def _feed_frames(self, records: FrameArray) -> list[StreamItem]:
        """Decode data frames of the object."""
        self._tally["frames"] += len(records)
        good = _right_lengths(records["arbitration_id"] >> NODE_BITS, records)
        if not good.all():
            self._tally["wrong_lengths"] += int(len(good) - good.sum())
            records = records[good]
        held = self._samples.take_held()
        if held is not None:
            records = concatenate_frames([held, records])
        function = records["arbitration_id"] >> NODE_BITS
        edges = [0, *self._boots.starts(function, records, self._samples.expected), len(records)]
        items = self._decode(function[: edges[1]], records[: edges[1]])
        for start, end in itertools.pairwise(edges[1:]):
            items += self.flush()
            self._samples = SampleDecoder(self._tally)
            items += self._decode(function[start:end], records[start:end])
        return items

    def _decode(self, function: npt.NDArray[Any], records: FrameArray, is_last: bool = False) -> list[StreamItem]:
        """Decode frames of one boot."""
        found, others = self._decode_located(function, records, is_last)
        return in_wire_order(found.batch, ((position, packet) for position, packet, _ in others))

    def _decode_located(
        self, function: npt.NDArray[Any], records: FrameArray, is_last: bool = False
    ) -> tuple[FoundSamples, list[tuple[int, Packet | ForeignInfo, int]]]:
        """Decode frames of one boot; return the samples, and all others: before which of these, and in which frame."""
        found = self._samples.decode(function, records, is_last)
        if self._boots.in_conflict:
            self._tally["refused"] += len(found.rows)
            found = found.refused()
        if len(found.bad_rows):
            self._damage += (self._n_samples + np.searchsorted(found.rows, np.sort(found.bad_rows))).tolist()
        self._n_samples += len(found.rows)
        others: list[tuple[int, Packet | ForeignInfo, int]] = []
        is_rare = (function != SAMPLE) & (function != WHOLE_SAMPLE) & (function != TIME) & (function != STATE)
        for row in np.flatnonzero(is_rare).tolist():
            before = found.counter_before(row)
            reference = self._samples.expected if before is None else before
            position = int(np.searchsorted(found.rows, row))
            packets = self._rare.feed(int(function[row]), records[row], reference, self._samples.timeline)
            others += [(position, packet, row) for packet in packets]
        self._samples.forget_past()
        return found, others


def _right_lengths(function: npt.NDArray[Any], records: FrameArray) -> npt.NDArray[np.bool_]:
    """Return (n,) whether each frame has a length that its function allows."""
    length = records["length"]
    wanted = _LENGTHS[function & FUNCTION_MASK]
    good = (wanted == _ANY_LENGTH) & (length > 0) | (wanted == length)
    is_whole = function >= WHOLE
    if is_whole.any():
        is_long = (function & FUNCTION_MASK) >= CanFunction.LONG_TO_OBJECT
        size = records["data"][:, 0]
        good = np.where(is_whole, is_long | (size > 0) & (size < length), good)
    return np.asarray(good)
