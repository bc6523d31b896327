"""Raw ticks through the clock's parts without an object: every jump is taken for a new segment."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from host.clock.remap import remap
from host.clock.unwrap import ClockUnwrapper


class Step(NamedTuple):
    index: int
    segment: int
    host_time_ns: int
    disagreement_us: int
    gap_ns: int


class UnwrappedChunks:
    """A :class:`ClockUnwrapper` and whoever decides that each jump starts a segment."""

    def __init__(self):
        self.clock = ClockUnwrapper()
        self.segment = 0
        self._steps = []

    @property
    def newest_us(self):
        return self.clock.newest_us

    def locate(self, device_time_us, host_time_ns):
        return self.clock.locate(device_time_us, host_time_ns)

    def new_segment(self):
        if self.clock.newest_us is not None:
            self.clock.new_segment()
            self.segment += 1
        return self.segment

    def pieces(self, device_time_us, host_time_ns):
        """Unwrapped times of one chunk, a piece for each segment; all but the last may be empty."""
        ticks, start = np.asarray(device_time_us, dtype=np.int64), 0
        while True:
            _, gap_ns = self.clock.jump(0, host_time_ns)
            unwrapped = self.clock.unwrap(ticks[start:], host_time_ns)
            yield unwrapped
            start += len(unwrapped)
            if start == len(ticks):
                return
            disagreement_us, _ = self.clock.jump(int(ticks[start]), host_time_ns)
            self._steps.append(Step(start, self.new_segment(), host_time_ns, disagreement_us, gap_ns))

    def feed(self, device_time_us, host_time_ns):
        if np.ndim(device_time_us) != 1:
            return self.clock.unwrap(device_time_us, host_time_ns)
        return np.concatenate(list(self.pieces(device_time_us, host_time_ns)))

    def take_steps(self):
        steps, self._steps = self._steps, []
        return steps


def remapped(device_time_us, arrival_ns, segment_starts=(), **options):
    """The offline pass over raw ticks, in order of reception."""
    ticks, arrival_ns = np.asarray(device_time_us, dtype=np.int64), np.asarray(arrival_ns, dtype=np.int64)
    chunks, unwrapped, jumps = UnwrappedChunks(), np.empty_like(ticks), []
    edges = np.unique([0, *(np.flatnonzero(np.diff(arrival_ns)) + 1), *segment_starts, len(ticks)])
    edges = [edge for edge in edges.tolist() if 0 <= edge <= len(ticks)]
    for start, stop in pairwise(edges):
        if start in segment_starts:
            chunks.new_segment()
        unwrapped[start:stop] = chunks.feed(ticks[start:stop], int(arrival_ns[start]))
        jumps += [start + step.index for step in chunks.take_steps()]
    return remap(unwrapped, arrival_ns, segment_starts, jumps, **options)
