"""Chunks in, packets out, counted: the same for live links and for recordings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from firmware_protocol.items import LocatedPackets, StreamCounters, StreamItem
from firmware_protocol.serial.decoder import StreamDecoder
from host.links.transport import AnyChunk, FrameChunk, GapChunk

if TYPE_CHECKING:
    from firmware_protocol.can.decoder import CanStreamDecoder

COALESCED_BYTES = 65536
COALESCED_NS = 250_000_000


class Link:
    """Decodes the chunks of one object's link; the first shows whether they are of bytes or of CAN frames.

    Parameters
    ----------
    node : int or None
        Node id of the object on a CAN bus; None takes the first that is heard.
    """

    def __init__(self, node: int | None = None) -> None:
        self._decoder: StreamDecoder | CanStreamDecoder = StreamDecoder()
        self._node = node
        self._undecided = True  # no chunk has shown yet which kind of link it is
        self.n_bytes = 0
        """Bytes received."""

    @property
    def counters(self) -> StreamCounters:
        """Snapshot of what was met so far."""
        return self._decoder.counters

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know of the link's traffic, a sentence each."""
        return tuple(getattr(self._decoder, "problems", ()))

    @property
    def is_of_bytes(self) -> bool:
        """Whether it started with bytes, or with nothing yet; not with CAN frames."""
        return isinstance(self._decoder, StreamDecoder)

    def feed(self, chunk: AnyChunk) -> list[StreamItem]:
        """Decode one chunk; return what it completed, in wire order.

        An empty chunk (the link was opened again) ends the frame under way; what is returned came before the cut.
        """
        if isinstance(chunk, GapChunk):
            self.skip_gap()
            return []
        if chunk.reopened:
            held = self.flush()
            self._decoder.restart()
            return held
        if self._undecided and isinstance(chunk, FrameChunk):
            # Its import takes a while, and a serial capture has no use for it.
            from firmware_protocol.can.decoder import CanStreamDecoder

            self._decoder = CanStreamDecoder(self._node)
        self._undecided = False
        self.n_bytes += len(chunk.data)
        return self._decoder.feed(chunk.data)

    def feed_span(self, data: bytes) -> LocatedPackets:
        """Decode many chunks of a byte link put end to end; return what they completed, and where each of it ends.

        Raises
        ------
        TypeError
            Not one of bytes: see :attr:`is_of_bytes`.
        """
        self._undecided = False
        self.n_bytes += len(data)
        if not isinstance(self._decoder, StreamDecoder):
            raise TypeError("CAN frames cannot be put end to end")
        return self._decoder.feed_located(data)

    def feed_frames(self, chunks: Sequence[AnyChunk]) -> LocatedPackets | None:
        """Decode many chunks of a CAN link together; return what they completed, and with which of all their frames.

        None, and nothing is taken into account, where what comes could depend on that: feed them one by one.
        """
        if self._undecided or isinstance(self._decoder, StreamDecoder):
            return None
        data = b"".join(chunk.data for chunk in chunks)
        packets = self._decoder.feed_located(data)
        if packets is not None:
            self.n_bytes += len(data)
        return packets

    def skip_gap(self) -> None:
        """Note that a recording lacks records here: half a frame before and half a frame behind are not one damaged.

        CAN frames are whole in their records, and a bus that lost some is what their decoder is made for.
        """
        if isinstance(self._decoder, StreamDecoder):
            self._decoder.restart()

    def take_damage(self) -> list[int]:
        """Return after how many samples, of all delivered, damaged frames came since the last call; ascending."""
        return self._decoder.take_damage()

    def flush(self) -> list[StreamItem]:
        """Return what the decoder still holds: the link is over.

        CAN samples behind a long silence wait for the frame that shows which they are.
        """
        return self._decoder.flush()


def grouped(
    chunks: Iterable[AnyChunk], max_bytes: int = COALESCED_BYTES, max_span_ns: int = COALESCED_NS
) -> Iterator[list[AnyChunk]]:
    """Put neighbouring chunks together that may be joined, up to so many bytes and over so much time.

    A chunk of one sample costs as much as one of a hundred. Empty chunks stay by themselves.
    """
    kept: list[AnyChunk] = []
    size = 0
    for chunk in chunks:
        if kept and (
            not (chunk.data and kept[0].data)
            or size + len(chunk.data) > max_bytes
            or chunk.host_time_ns - kept[0].host_time_ns > max_span_ns
            or type(chunk) is not type(kept[0])
        ):
            yield kept
            kept, size = [], 0
        kept.append(chunk)
        size += len(chunk.data)
    if kept:
        yield kept
