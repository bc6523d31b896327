"""Checking the message indexes behind a chunk against the messages in it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from mcap.records import MessageIndex

from host.recording.bulk.record_runs import MessageRun, by_channel
from host.recording.check.account import Findings
from host.recording.check.messages import CheckedChannel
from host.recording.check.summary import WRONG_INDEX, MetChunk

IntArray = npt.NDArray[np.int64]


class MessageIndexCheck:
    """Keeps the messages of the last chunk, by channel, until the records behind it have stated them."""

    def __init__(self, damage: Findings) -> None:
        self._damage = damage
        self._at = 0
        self._chunk: MetChunk | None = None
        self._messages: dict[int, list[tuple[int, int]]] = {}  # time and place in the chunk, not stated yet

    def start(self, at: int, chunk: MetChunk) -> None:
        """Enter a chunk; its messages follow."""
        self.finish({})
        self._at, self._chunk = at, chunk

    def add_messages(self, run: MessageRun, times_ns: IntArray) -> None:
        """Enter messages of the chunk."""
        for channel, chosen in by_channel(run.channels):
            entries = zip(times_ns[chosen].tolist(), run.starts[chosen].tolist(), strict=True)
            self._messages.setdefault(channel, []).extend(entries)

    def add_index(self, at: int, found: MessageIndex, size: int) -> None:
        """Enter a message index, ``size`` bytes long."""
        if self._chunk is None:
            self._damage.add(at, "a message index without a chunk in front of it", WRONG_INDEX)
            return
        self._chunk.index_places[found.channel_id] = at
        self._chunk.index_bytes += size
        if sorted(self._messages.pop(found.channel_id, [])) != sorted(found.records):
            what = f"a message index of channel {found.channel_id} does not fit its chunk at {self._at}"
            self._damage.add(at, what, WRONG_INDEX)

    def finish(self, channels: dict[int, CheckedChannel]) -> None:
        """Note that no more indexes follow the last chunk; a writer may write none at all."""
        if self._chunk is not None and self._chunk.index_bytes:
            for channel in self._messages:
                name = channels[channel].topic if channel in channels else str(channel)
                self._damage.add(self._at, f"the chunk has no message index of channel {name}", WRONG_INDEX)
        self._chunk = None
        self._messages = {}
