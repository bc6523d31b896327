"""What a transport delivers and how it is used: chunks with the host time of their reception."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self, TypeAlias

if TYPE_CHECKING:
    from firmware_protocol.can.frames import CanFrame
    from firmware_protocol.packets import Command

MAX_CHUNK_BYTES = 65536
"""No read returns more, so that one chunk never holds up the capture."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """Whatever one read of a byte link returned.

    An empty one marks that the link was lost and is open again: whatever started before is over. It is recorded like
    any other, so that a recording shows it.
    """

    data: bytes
    """The bytes as received; empty where the link was opened again."""
    host_time_ns: int
    """``time.monotonic_ns()`` right at reception."""

    def __len__(self) -> int:
        return len(self.data)

    @property
    def reopened(self) -> bool:
        """Whether it marks that the link was lost and is open again."""
        return not self.data


@dataclass(frozen=True, slots=True)
class FrameChunk(Chunk):
    """Whatever one read of a CAN link returned: ``data`` is a frame batch (:mod:`firmware_protocol.can.frames`).

    The frames are in order of reception, each with its own host time and the interface's raw time stamp;
    ``host_time_ns`` is that of the last. A recording keeps the bytes as they are.
    """

    @property
    def frames(self) -> list[CanFrame]:
        """The frames one by one; slow, for a few."""
        from firmware_protocol.can.frames import unpack_frames

        return unpack_frames(self.data)


@dataclass(frozen=True, slots=True)
class GapChunk(Chunk):
    """Marks where records are missing from a recording that is replayed: the file is damaged there, not the link.

    It has no data, and the time of the chunk before.
    """

    records: int
    """How many are missing; 0 where that is not known."""

    @property
    def reopened(self) -> bool:
        """False: nobody opened a link here."""
        return False


AnyChunk: TypeAlias = Chunk | FrameChunk | GapChunk


class LinkEnd(Exception):  # noqa: N818 - not an error: a replay has an end, a live link has not
    """The link has delivered everything it will ever deliver."""


class Transport(ABC):
    """An open link, closed where its ``with`` block ends.

    ``read`` and ``close`` belong to one thread, ``write`` may come from another.
    """

    name: str
    """The link as a person would name it: its URI."""
    is_live: bool = True
    """Whether somebody may answer; False for a replay."""

    @property
    def connected(self) -> bool:
        """Whether the link is open now; a link that is opened again by itself may be lost for a while."""
        return True

    @property
    def node(self) -> int | None:
        """Node id of the object on a bus; None on a link of one object, and while none is known."""
        return None

    @property
    def interface_name(self) -> str:
        """What a CAN interface calls itself; empty on other links."""
        return ""

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know of the link, a sentence each; only ever grows."""
        return ()

    def proven(self) -> None:  # noqa: B027 - most links have nothing to note
        """Note that the object was heard: a link that is opened again by itself has proven good."""

    def encode_command(self, command: Command) -> bytes:
        """Return what :meth:`write` sends for a command: the frame of a serial link, the bare packet on CAN."""
        from firmware_protocol.serial.decoder import encode_command

        return encode_command(command)

    @abstractmethod
    def read(self, timeout_s: float) -> AnyChunk | None:
        """Wait for the next chunk, at most ``timeout_s``; None when nothing came.

        Raises
        ------
        LinkEnd
            A replay is over.
        LinkLostError
            The link is gone.
        """

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send an encoded command.

        Raises
        ------
        LinkLostError
            The link is gone or does not accept it within a second.
        """

    @abstractmethod
    def close(self) -> None:
        """Close the link; never raises, may be called twice."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class TransportAround(Transport):
    """A transport that adds something to the one inside it."""

    _inner: Transport

    @property
    def connected(self) -> bool:
        """That of the transport inside."""
        return self._inner.connected

    @property
    def node(self) -> int | None:
        """That of the transport inside."""
        return self._inner.node

    @property
    def interface_name(self) -> str:
        """That of the transport inside."""
        return self._inner.interface_name

    def proven(self) -> None:
        """Inform the transport inside."""
        self._inner.proven()

    def encode_command(self, command: Command) -> bytes:
        """Return what the transport inside sends for a command."""
        return self._inner.encode_command(command)


def joined(chunks: list[AnyChunk]) -> AnyChunk:
    """Return several chunks of a kind as one; it was received when the last of them was."""
    if len(chunks) == 1:
        return chunks[0]
    return type(chunks[0])(b"".join(chunk.data for chunk in chunks), chunks[-1].host_time_ns)
