"""Chunks in, packets out, counted: the same for live links and for recordings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

from firmware_protocol.items import StreamCounters, StreamItem
from firmware_protocol.serial.decoder import LocatedPackets, StreamDecoder
from host.links.transport import AnyChunk, FrameChunk

COALESCED_BYTES = 65536
COALESCED_NS = 250_000_000


class PacketDecoder(Protocol):
    """What turns the data of chunks into packets: one kind for bytes, one for CAN frames."""

    def feed(self, data: bytes) -> list[StreamItem]:
        """Take the data of one chunk; return what it completed, in wire order. Never raises on what came in."""

    @property
    def counters(self) -> StreamCounters:
        """Snapshot of what was met so far."""

    def take_damage(self) -> list[int]:
        """Tell after how many samples, of all delivered, damaged frames came since the last call; ascending."""

    def flush(self) -> list[StreamItem]:
        """Give away what is still held: nothing follows."""

    def restart(self) -> None:
        """Begin anew after the link was cut; the counters go on."""


class Link:
    """Decodes the chunks of one object's link.

    Parameters
    ----------
    decoder : PacketDecoder, optional
        By default the one for the first chunk's kind.
    node : int or None
        Node id of the object on a CAN bus; None takes the first that is heard.
    """

    def __init__(self, decoder: PacketDecoder | None = None, node: int | None = None) -> None:
        self._decoder = decoder
        self._node = node
        self.n_bytes = 0
        """Bytes received."""

    @property
    def counters(self) -> StreamCounters:
        """Snapshot of what was met so far."""
        return StreamCounters() if self._decoder is None else self._decoder.counters

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should be told of the link's traffic, a sentence each."""
        return tuple(getattr(self._decoder, "problems", ()))

    @property
    def is_of_bytes(self) -> bool:
        """Whether it began with bytes, or with nothing yet; not with CAN frames."""
        return self._decoder is None or isinstance(self._decoder, StreamDecoder)

    def feed(self, chunk: AnyChunk) -> list[StreamItem]:
        """Decode one chunk; what it completed, in wire order.

        An empty chunk (the link was opened again) ends the frame begun before; what it gives came before the cut.
        """
        if not chunk.data:
            held = self.flush()
            if self._decoder is not None:
                self._decoder.restart()
            return held
        if self._decoder is None:
            self._decoder = decoder_for(chunk, self._node)
        self.n_bytes += len(chunk.data)
        return self._decoder.feed(chunk.data)

    def feed_stretch(self, data: bytes) -> LocatedPackets:
        """Decode many chunks of a byte link put end to end; what they completed, and where in them each of it ends.

        Raises
        ------
        TypeError
            Not one of bytes: see :attr:`is_of_bytes`.
        """
        if self._decoder is None:
            self._decoder = StreamDecoder()
        self.n_bytes += len(data)
        if not isinstance(self._decoder, StreamDecoder):
            raise TypeError("bytes put end to end are no CAN frames")
        return self._decoder.feed_located(data)

    def take_damage(self) -> list[int]:
        """Tell after how many samples, of all delivered, damaged frames came since the last call; ascending."""
        return [] if self._decoder is None else self._decoder.take_damage()

    def flush(self) -> list[StreamItem]:
        """Give away what the decoder still holds: the link is over.

        CAN samples behind a long silence wait for the frame that says which they are.
        """
        return [] if self._decoder is None else self._decoder.flush()


def decoder_for(chunk: AnyChunk, node: int | None = None) -> PacketDecoder:
    """Make the decoder for a chunk's kind; ``node`` is the node id on a CAN bus, None for the first that is heard."""
    if isinstance(chunk, FrameChunk):
        # Its import takes a while, and a serial capture has no use for it.
        from firmware_protocol.can.decoder import CanStreamDecoder

        return CanStreamDecoder(node)
    return StreamDecoder()


def grouped(
    chunks: Iterable[AnyChunk], max_bytes: int = COALESCED_BYTES, max_span_ns: int = COALESCED_NS
) -> Iterator[list[AnyChunk]]:
    """Put neighbouring chunks together that may be joined.

    A chunk of one sample costs as much as one of a hundred. Empty chunks stay by themselves. The packets do not depend
    on how the bytes are cut; the time of reception becomes that of the last chunk joined, which only a clock estimate
    would notice.

    Parameters
    ----------
    chunks : iterable of AnyChunk
        In order.
    max_bytes : int
        Longest result, unless a single chunk is longer.
    max_span_ns : int
        Longest time between the first and the last chunk joined.
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
