"""The CAN frames of one object in, packets out: the counterpart of the serial ``StreamDecoder``, one node at a time."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.counters import CanCounters
from firmware_protocol.can.few_samples import next_samples
from firmware_protocol.can.frames import CanFrame, FrameArray, concatenate_frames
from firmware_protocol.can.mapping import (
    COUNTER_MODULUS,
    EXACT_LENGTHS,
    FD_BIT,
    NODE_BITS,
    CanFunction,
)
from firmware_protocol.can.numbering import LATE_WINDOW, MAX_HELD, Marks, Numbering
from firmware_protocol.can.rare_frames import RareFrames
from firmware_protocol.can.timeline import Timeline
from firmware_protocol.items import StreamItem
from firmware_protocol.packets import OrientationBatch, PacketType
from firmware_protocol.quantization import quats_from_q15, quats_from_smallest_three
from firmware_protocol.sequence import SequenceTracker

IntArray = npt.NDArray[np.int64]

WHOLE = FD_BIT >> NODE_BITS
"""Bit of a frame's function that says: a whole packet in a CAN FD frame."""
_SAMPLE = int(CanFunction.ORIENTATION)
_WHOLE_SAMPLE = WHOLE | int(CanFunction.ORIENTATION)
_TIME = int(CanFunction.TIME)
_STATE = int(CanFunction.SAMPLE_STATE)
_ANY_LENGTH = 255
_LENGTHS = np.full(WHOLE, _ANY_LENGTH, np.uint8)
for _function, _length in EXACT_LENGTHS.items():
    _LENGTHS[_function] = _length
_WHOLE_DTYPE = np.dtype(
    [
        ("size", "u1"),
        ("type", "u1"),
        ("sequence", "<u2"),
        ("device_time_us", "<u4"),
        ("q", "<i2", (4,)),
        ("flags", "u1"),
    ]
)


class NodeDecoder:
    """Turn the frames of one node into packets, in wire order.

    Parameters
    ----------
    node : int
        Node id, 1-31.
    answers : bool
        Whether frames of our own may be sent (flow control); they are taken with :meth:`take_outgoing`.
    """

    def __init__(self, node: int, answers: bool = False) -> None:
        self.node = node
        self._rare = RareFrames(node, answers)
        self._numbering = Numbering()
        self._timeline = Timeline()
        self._sequence = SequenceTracker()
        self._held: FrameArray | None = None
        self._tag = 0
        self._old_tags: set[int] = set()
        self._returned_tags = 0
        self._frames = self._samples = self._malformed = self._extended = 0
        self._wrong_lengths = self._unnumbered = self._refused = 0
        self._bad_rows: list[int] = []  # of the run being decoded: samples that cannot be used
        self._damage: list[int] = []

    @property
    def in_conflict(self) -> bool:
        """Whether two objects with this node id are on the bus: their boot tags come back in turn."""
        return self._returned_tags >= 2

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should be told, a sentence each."""
        if self.in_conflict:
            return (f"two objects on the bus have node id {self.node}, so their samples cannot be told apart",)
        return ()

    @property
    def counters(self) -> CanCounters:
        """Snapshot of the counters of this node; those of the bus are the bus decoder's."""
        rare = self._rare
        packets = dict(rare.packets)
        if self._samples:
            packets[PacketType.ORIENTATION] = self._samples
        return CanCounters(
            **asdict(self._sequence.counters),
            frames=self._frames,
            packets=MappingProxyType(packets),
            malformed=self._malformed + rare.malformed,
            unknown_types=rare.unknown_types,
            unsupported_versions=rare.unsupported_versions,
            extended=self._extended + rare.extended,
            host_frames=rare.host_frames,
            wrong_lengths=self._wrong_lengths,
            unnumbered=self._unnumbered,
            misnumbered=self._numbering.misnumbered,
            refused=self._refused,
            long_packet_errors=rare.long_packet_errors,
        )

    def feed(self, records: FrameArray) -> list[StreamItem]:
        """Take frames of this node, neither remote nor error frames; return what they complete, in wire order."""
        self._frames += len(records)
        function = records["arbitration_id"] >> NODE_BITS
        good = _right_lengths(function, records)
        if not good.all():
            self._wrong_lengths += int(len(good) - good.sum())
            records = records[good]
        if self._held is not None:
            records = concatenate_frames([self._held, records])
            self._held = None
        function = records["arbitration_id"] >> NODE_BITS
        edges = [0, *self._new_boots(function, records), len(records)]
        items = self._run(function[: edges[1]], records[: edges[1]])
        for start, end in itertools.pairwise(edges[1:]):
            items += self.flush()
            self._forget()
            items += self._run(function[start:end], records[start:end])
        return items

    def feed_next(self, frames: Sequence[tuple[int, int]]) -> OrientationBatch | None:
        """Take a few ORIENTATION frames (host time, data as u64) if they are plainly the next samples; else None."""
        if self._held is not None or self.in_conflict:
            return None
        batch = next_samples(frames, self._numbering, self._timeline)
        if batch is not None:
            self._count(batch)
        return batch

    def feed_whole(self, batch: OrientationBatch) -> bool:
        """Take samples of CAN FD frames, decoded already; False, and nothing changed, where they must be judged."""
        if self._held is not None or self.in_conflict:
            return False
        self._count(batch)
        return True

    def _count(self, batch: OrientationBatch) -> None:
        self._frames += len(batch)
        self._samples += len(batch)
        self._sequence.feed(batch.sequence.tolist())

    def flush(self) -> list[StreamItem]:
        """Give away the samples still held, numbered as well as can be: no TIME frame will follow."""
        if self._held is None:
            return []
        held, self._held = self._held, None
        return self._run(held["arbitration_id"] >> NODE_BITS, held, is_last=True)

    def take_outgoing(self) -> list[CanFrame]:
        """Return the flow control frames to be sent since the last call."""
        return self._rare.take_outgoing()

    def take_damage(self) -> list[int]:
        """Tell after how many samples, of all delivered, unusable ones came since the last call; ascending."""
        damage, self._damage = self._damage, []
        return damage

    def restart(self) -> None:
        """Begin anew after the link was cut; the counters go on."""
        self._forget()
        self._rare.restart()

    def _forget(self) -> None:
        if self._held is not None:
            self._unnumbered += len(self._held)
        self._held = None
        self._numbering = Numbering(misnumbered=self._numbering.misnumbered)
        self._timeline = Timeline()
        self._sequence.restart()

    def _new_boots(self, function: npt.NDArray[Any], records: FrameArray) -> list[int]:
        """Positions where the object began anew: another boot tag, or a sample counter that falls."""
        rows = np.flatnonzero((function == _TIME) | (function == _STATE))
        if len(rows) == 0:
            return []
        codes = records["code"][rows]
        counters = codes.astype(np.uint32)
        expected = self._numbering.expected
        before = counters[:1] if expected is None else np.array([expected % COUNTER_MODULUS], np.uint32)
        falls = np.diff(np.concatenate([before, counters])).view(np.int32) < -LATE_WINDOW
        tags = (codes >> np.uint64(56)).astype(np.uint8)
        tags[function[rows] == _TIME] = 0
        others = (tags != 0) & (tags != self._tag)
        if not (falls.any() or others.any()):
            return []
        boots = []
        for row, fell, tag in zip(rows.tolist(), falls.tolist(), tags.tolist(), strict=True):
            is_new = False
            if tag not in (0, self._tag):
                is_new = self._tag != 0
                self._returned_tags += tag in self._old_tags
                self._old_tags.add(self._tag)
                self._tag = tag
            if is_new or fell:
                boots.append(row)
        return boots

    def _run(self, function: npt.NDArray[Any], records: FrameArray, is_last: bool = False) -> list[StreamItem]:
        """Decode frames of one boot."""
        samples = np.flatnonzero(function == _SAMPLE)
        rows, counters, batch = self._classic_samples(function, records, samples, is_last)
        whole = np.flatnonzero(function == _WHOLE_SAMPLE)
        if len(whole):
            whole_rows, whole_batch = self._whole_samples(records, whole)
            rows, batch = _merged(rows, batch, whole_rows, whole_batch)
        if self.in_conflict:
            self._refused += len(rows)
            self._bad_rows += rows.tolist()
            rows = rows[:0]
        if self._bad_rows:
            self._damage += (self._samples + np.searchsorted(rows, sorted(self._bad_rows))).tolist()
            self._bad_rows.clear()
        if len(rows):
            self._samples += len(rows)
            self._sequence.feed_array(batch.sequence)
        items: list[StreamItem] = []
        given = 0
        is_rare = (function != _SAMPLE) & (function != _WHOLE_SAMPLE) & (function != _TIME) & (function != _STATE)
        for row in np.flatnonzero(is_rare).tolist():
            before = int(np.searchsorted(samples[: len(counters)], row))
            reference = int(counters[before - 1]) if before else self._numbering.expected
            for item in self._rare.feed(int(function[row]), records[row], reference, self._timeline):
                upto = int(np.searchsorted(rows, row))
                if upto > given:
                    items.append(_part(batch, given, upto))
                    given = upto
                items.append(item)
        if len(rows) > given:
            items.append(_part(batch, given, len(rows)))
        if self._numbering.expected is not None:
            self._timeline.forget_before(self._numbering.expected - LATE_WINDOW - 1)
        return items

    def _classic_samples(
        self, function: npt.NDArray[Any], records: FrameArray, samples: npt.NDArray[np.intp], is_last: bool
    ) -> tuple[npt.NDArray[np.intp], IntArray, OrientationBatch]:
        """Decode classic ORIENTATION frames; return rows of the good ones, counters of all, and the samples."""
        marks = np.flatnonzero(function == _TIME)
        states = np.flatnonzero(function == _STATE)
        nothing = samples[:0], np.empty(0, np.int64), _NO_SAMPLES
        codes, host_ns = records["code"], records["host_time_ns"]
        reference = self._numbering.expected
        if reference is None and len(marks) + len(states):
            reference = int(codes[(marks if len(marks) else states)[0]].astype(np.uint32))
        mark_counters = np.empty(0, np.int64)
        if reference is not None:
            if len(states):
                self._malformed += self._timeline.add_states(codes[states], reference)
            if len(marks):
                mark_counters = self._timeline.add_marks(codes[marks], reference)
        if not len(samples) and not len(marks):
            return nothing
        if not self._timeline.is_known:
            if is_last:
                self._unnumbered += len(samples)
            else:
                self._hold(records[np.sort(np.concatenate([samples, marks]))])
            return nothing
        counters, taken = self._numbering.number(
            codes[samples].astype(np.uint8),
            host_ns[samples],
            Marks(np.searchsorted(samples, marks).astype(np.int64), mark_counters, host_ns[marks]),
            self._timeline.period_ns,
            may_hold=not is_last,
        )
        if taken < len(samples):
            self._hold(records[samples[taken:]])
        quats, good = quats_from_smallest_three(codes[samples[:taken]] >> np.uint64(8))
        self._note_malformed(samples[:taken][~good])
        self._unnumbered += int((good & (counters < 0)).sum())
        good &= counters >= 0
        kept = counters[good]
        batch = OrientationBatch(
            sequence=(kept & 0xFFFF).astype(np.uint16),
            device_time_us=self._timeline.device_times_us(kept),
            quats_wxyz=quats[good],
            flags=self._timeline.flags(kept),
        )
        return samples[:taken][good], counters, batch

    def _note_malformed(self, rows: npt.NDArray[np.intp]) -> None:
        self._malformed += len(rows)
        self._bad_rows += rows.tolist()

    def _hold(self, records: FrameArray) -> None:
        excess = max(len(records) - MAX_HELD, 0)
        if excess:
            self._unnumbered += int((records["arbitration_id"][:excess] >> NODE_BITS == _SAMPLE).sum())
        self._held = records[excess:].copy()

    def _whole_samples(
        self, records: FrameArray, rows: npt.NDArray[np.intp]
    ) -> tuple[npt.NDArray[np.intp], OrientationBatch]:
        """Decode ORIENTATION packets in CAN FD frames."""
        data = np.zeros((len(rows), _WHOLE_DTYPE.itemsize), np.uint8)
        given = records["data"][rows][:, : _WHOLE_DTYPE.itemsize]
        data[:, : given.shape[1]] = given  # eight bytes where somebody sends the id in a classic frame
        fields = data.view(_WHOLE_DTYPE)[:, 0]
        shaped = (fields["size"] >= _WHOLE_DTYPE.itemsize - 1) & (fields["type"] == int(PacketType.ORIENTATION))
        quats, good = quats_from_q15(fields["q"])
        good &= shaped
        self._note_malformed(rows[~good])
        self._extended += int((good & (fields["size"] > _WHOLE_DTYPE.itemsize - 1)).sum())
        fields = fields[good]
        batch = OrientationBatch(
            sequence=fields["sequence"].copy(),
            device_time_us=fields["device_time_us"].copy(),
            quats_wxyz=quats[good],
            flags=fields["flags"].copy(),
        )
        return rows[good], batch


_NO_SAMPLES = OrientationBatch(
    np.empty(0, np.uint16), np.empty(0, np.uint32), np.empty((0, 4), np.float64), np.empty(0, np.uint8)
)


def _right_lengths(function: npt.NDArray[Any], records: FrameArray) -> npt.NDArray[np.bool_]:
    length = records["length"]
    wanted = _LENGTHS[function & (WHOLE - 1)]
    good = (wanted == _ANY_LENGTH) & (length > 0) | (wanted == length)
    is_whole = function >= WHOLE
    if is_whole.any():
        is_long = (function & (WHOLE - 1)) >= CanFunction.LONG_TO_OBJECT
        size = records["data"][:, 0]
        good = np.where(is_whole, is_long | (size > 0) & (size < length), good)
    return np.asarray(good)


def _part(batch: OrientationBatch, start: int, end: int) -> OrientationBatch:
    if start == 0 and end == len(batch):
        return batch
    part = slice(start, end)
    return OrientationBatch(batch.sequence[part], batch.device_time_us[part], batch.quats_wxyz[part], batch.flags[part])


def _merged(
    rows: npt.NDArray[np.intp], batch: OrientationBatch, more_rows: npt.NDArray[np.intp], more: OrientationBatch
) -> tuple[npt.NDArray[np.intp], OrientationBatch]:
    """Join samples of both kinds in wire order; an object sends one kind, so mostly there is nothing to join."""
    if not len(rows):
        return more_rows, more
    joined = np.concatenate([rows, more_rows])
    order = np.argsort(joined, kind="stable")
    return joined[order], OrientationBatch(
        np.concatenate([batch.sequence, more.sequence])[order],
        np.concatenate([batch.device_time_us, more.device_time_us])[order],
        np.concatenate([batch.quats_wxyz, more.quats_wxyz])[order],
        np.concatenate([batch.flags, more.flags])[order],
    )
