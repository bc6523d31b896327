"""ORIENTATION frames as samples: numbered, timed and flagged by the TIME and SAMPLE_STATE frames among them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_protocol.can.few_samples import next_samples
from firmware_protocol.can.frames import FrameArray
from firmware_protocol.can.mapping import COUNTER_MODULUS, NODE_BITS, SEQUENCE_MODULUS, WHOLE, CanFunction
from firmware_protocol.can.numbering import LATE_WINDOW, MAX_HELD, SILENCE_SAMPLES, Marks, Numbering
from firmware_protocol.can.timeline import Timeline
from firmware_protocol.codec import ORIENTATION_DTYPE
from firmware_protocol.items import Tally
from firmware_protocol.packets import OrientationBatch, PacketType
from firmware_protocol.quantization import quats_from_q15, quats_from_smallest_three

IntArray = npt.NDArray[np.int64]
RowArray = npt.NDArray[np.intp]

SAMPLE = int(CanFunction.ORIENTATION)
WHOLE_SAMPLE = WHOLE | SAMPLE
TIME = int(CanFunction.TIME)
STATE = int(CanFunction.SAMPLE_STATE)
MAX_STEP = 100
"""Samples missing in a row that are still plain: far below what eight bits could mistake."""
_WHOLE_DTYPE = np.dtype([("size", "u1"), ("packet", ORIENTATION_DTYPE)])


@dataclass(frozen=True, slots=True, eq=False)
class FoundSamples:
    """The k samples among n frames."""

    rows: RowArray
    """(k,) which of the frames they are, ascending."""
    batch: OrientationBatch
    """The samples, in wire order."""
    bad_rows: RowArray
    """Samples that cannot be used."""
    numbered_rows: RowArray
    """All classic samples that were numbered, bad ones among them."""
    counters: IntArray
    """Their counters; negative where a sample has none."""

    def counter_before(self, row: int) -> int | None:
        """Return the counter of the last classic sample before a frame; None where there is none."""
        before = int(np.searchsorted(self.numbered_rows, row))
        return int(self.counters[before - 1]) if before else None

    def refused(self) -> FoundSamples:
        """Return the same frames, with no sample that can be used."""
        bad_rows = np.concatenate([self.bad_rows, self.rows])
        return FoundSamples(self.rows[:0], self.batch.part(slice(0)), bad_rows, self.numbered_rows, self.counters)

    def joined(self, rows: RowArray, batch: OrientationBatch, bad_rows: RowArray) -> FoundSamples:
        """Return these and other samples of the same frames, in wire order.

        An object sends samples of one kind, so mostly there is nothing to join.
        """
        bad_rows = np.concatenate([self.bad_rows, bad_rows])
        if len(self.rows):
            all_rows = np.concatenate([self.rows, rows])
            order = np.argsort(all_rows, kind="stable")
            rows = all_rows[order]
            batch = OrientationBatch(
                np.concatenate([self.batch.sequence, batch.sequence])[order],
                np.concatenate([self.batch.device_time_us, batch.device_time_us])[order],
                np.concatenate([self.batch.quats_wxyz, batch.quats_wxyz])[order],
                np.concatenate([self.batch.flags, batch.flags])[order],
            )
        return FoundSamples(rows, batch, bad_rows, self.numbered_rows, self.counters)


_NO_ROWS: RowArray = np.empty(0, np.intp)
_NO_COUNTERS: IntArray = np.empty(0, np.int64)
_NO_SAMPLES = OrientationBatch(
    np.empty(0, np.uint16), np.empty(0, np.uint32), np.empty((0, 4), np.float64), np.empty(0, np.uint8)
)
_NOTHING = FoundSamples(_NO_ROWS, _NO_SAMPLES, _NO_ROWS, _NO_ROWS, _NO_COUNTERS)


class SampleDecoder:
    """The samples of one boot of one object; forgotten by making a new one. The tally counts those of no use."""

    def __init__(self, tally: Tally) -> None:
        self.timeline = Timeline()
        """Device time and flags of samples."""
        self._numbering = Numbering(tally)
        self._held: FrameArray | None = None
        self._tally = tally

    @property
    def expected(self) -> int | None:
        """Counter of the next sample if none is lost; None before the first TIME frame."""
        return self._numbering.expected

    @property
    def holds(self) -> bool:
        """Whether samples wait for the TIME frame that shows which they are."""
        return self._held is not None

    def are_plain(self, function: npt.NDArray[Any], records: FrameArray) -> bool:
        """Return whether every sample follows plainly from the frames before it, so that many can be decoded together.

        Else frames that come later could have a say in earlier samples: a TIME frame that jumps, a silence in which
        samples may be missing unseen. The parameters are those of :meth:`decode`.
        """
        numbering, newest = self._numbering, self.timeline.newest
        expected = numbering.expected
        if expected is None or newest is None or self.holds or not self.timeline.is_before(expected):
            return False
        if numbering.newest is not None and numbering.newest >= expected:
            return False
        codes = records["code"]
        if (codes[function == STATE] >> np.uint64(40) & np.uint64(0xFFFF) != newest.rate_hz).any():
            return False
        counted = (function == SAMPLE) | (function == TIME) | (function == STATE)
        codes, is_sample = codes[counted], function[counted] == SAMPLE
        # Each frame shows a counter: a sample its own, TIME and SAMPLE_STATE that of the sample to come.
        low_bits = (codes & np.uint64(SEQUENCE_MODULUS - 1)).astype(np.int64)
        steps = (low_bits - np.concatenate(([expected], low_bits + is_sample))[:-1]) % SEQUENCE_MODULUS
        counters = expected + np.cumsum(steps + is_sample) - is_sample
        as_shown = (codes & np.uint64(COUNTER_MODULUS - 1)) == (counters % COUNTER_MODULUS).astype(np.uint64)
        if (steps > MAX_STEP).any() or not (as_shown | is_sample).all():
            return False
        heard = records["host_time_ns"][counted & (function != STATE)]
        waits_ns = np.diff(heard, prepend=numbering.silence.heard_ns)
        return bool(((waits_ns >= 0) & (waits_ns <= SILENCE_SAMPLES * self.timeline.period_ns)).all())

    def take_held(self) -> FrameArray | None:
        """Return the frames held, and hold them no longer: they go in front of the next ones."""
        held, self._held = self._held, None
        return held

    def next(self, frames: Sequence[tuple[int, int]]) -> OrientationBatch | None:
        """Decode ORIENTATION frames (host time, data as u64) if they are plainly the next samples; else None."""
        return next_samples(frames, self._numbering, self.timeline)

    def decode(self, function: npt.NDArray[Any], records: FrameArray, is_last: bool) -> FoundSamples:
        """Decode the samples among frames.

        Parameters
        ----------
        function : (n,)
            Bits 5-10 of the arbitration ids.
        records : (n,)
            Frames of the object, of the right lengths.
        is_last : bool
            Whether no TIME frame will follow, so that samples cannot wait for one.
        """
        found = self._classic(function, records, is_last)
        whole = np.flatnonzero(function == WHOLE_SAMPLE)
        if len(whole):
            found = found.joined(*self._whole(records, whole))
        return found

    def forget_past(self) -> None:
        """Drop what no frame to come needs."""
        if self.expected is not None:
            self.timeline.forget_before(self.expected - LATE_WINDOW - 1)

    def _classic(self, function: npt.NDArray[Any], records: FrameArray, is_last: bool) -> FoundSamples:
        samples = np.flatnonzero(function == SAMPLE)
        marks = np.flatnonzero(function == TIME)
        codes, host_ns = records["code"], records["host_time_ns"]
        mark_counters = self._learn(codes[marks], codes[function == STATE])
        if not len(samples) and not len(marks):
            return _NOTHING
        if not self.timeline.is_known:
            if is_last:
                self._tally["unnumbered"] += len(samples)
            else:
                self._hold(records[np.sort(np.concatenate([samples, marks]))])
            return _NOTHING
        counters, n = self._numbering.number(
            codes[samples].astype(np.uint8),
            host_ns[samples],
            Marks(np.searchsorted(samples, marks).astype(np.int64), mark_counters, host_ns[marks]),
            self.timeline.period_ns,
            may_hold=not is_last,
        )
        if n < len(samples):
            self._hold(records[samples[n:]])
            samples = samples[:n]
        quats, good = quats_from_smallest_three(codes[samples] >> np.uint64(8))
        bad_rows = samples[~good]
        self._tally["malformed"] += len(bad_rows)
        self._tally["unnumbered"] += int((good & (counters < 0)).sum())
        good &= counters >= 0
        kept = counters[good]
        batch = OrientationBatch(
            sequence=(kept & 0xFFFF).astype(np.uint16),
            device_time_us=self.timeline.device_times_us(kept),
            quats_wxyz=quats[good],
            flags=self.timeline.flags(kept),
        )
        return FoundSamples(samples[good], batch, bad_rows, samples, counters)

    def _learn(self, marks: npt.NDArray[np.uint64], states: npt.NDArray[np.uint64]) -> IntArray:
        """Enter TIME (k,) and SAMPLE_STATE frames; return the counters (k,) of the former, unwrapped."""
        reference = self.expected
        if reference is None and len(marks) + len(states):
            reference = int((marks if len(marks) else states)[0].astype(np.uint32))
        if reference is None:
            return _NO_COUNTERS
        if len(states):
            self._tally["malformed"] += self.timeline.add_states(states, reference)
        return self.timeline.add_marks(marks, reference) if len(marks) else _NO_COUNTERS

    def _hold(self, records: FrameArray) -> None:
        excess = max(len(records) - MAX_HELD, 0)
        if excess:
            self._tally["unnumbered"] += int((records["arbitration_id"][:excess] >> NODE_BITS == SAMPLE).sum())
        self._held = records[excess:].copy()

    def _whole(self, records: FrameArray, rows: RowArray) -> tuple[RowArray, OrientationBatch, RowArray]:
        """Decode ORIENTATION packets in CAN FD frames; return rows of the good ones, the samples, rows of the bad."""
        data = np.zeros((len(rows), _WHOLE_DTYPE.itemsize), np.uint8)
        sent = records["data"][rows][:, : _WHOLE_DTYPE.itemsize]
        data[:, : sent.shape[1]] = sent  # eight bytes where somebody sends the id in a classic frame
        size, packet = data[:, 0], data.view(_WHOLE_DTYPE)["packet"][:, 0]
        quats, good = quats_from_q15(packet["q"])
        good &= (size >= ORIENTATION_DTYPE.itemsize) & (packet["type"] == int(PacketType.ORIENTATION))
        bad_rows = rows[~good]
        self._tally["malformed"] += len(bad_rows)
        self._tally["extended"] += int((good & (size > ORIENTATION_DTYPE.itemsize)).sum())
        packet = packet[good]
        batch = OrientationBatch(
            sequence=packet["sequence"].copy(),
            device_time_us=packet["device_time_us"].copy(),
            quats_wxyz=quats[good],
            flags=packet["flags"].copy(),
        )
        return rows[good], batch, bad_rows
