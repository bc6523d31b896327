"""What a transport delivers and how it is used: chunks with the host time of their reception."""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, Self, TypeAlias

if TYPE_CHECKING:
    from firmware_protocol.can.frames import CanFrame
    from firmware_protocol.packets import Command

MAX_CHUNK_BYTES = 65536
"""No read returns more, so that one chunk never holds up the capture."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """Whatever one read of a byte link returned.

    An empty one says that the link was lost and is open again: whatever began before is over. It is recorded like any
    other, so that a recording tells of it.
    """

    data: bytes
    """The bytes as received; empty where the link was opened again."""
    host_time_ns: int
    """``time.monotonic_ns()`` right at reception."""

    def __len__(self) -> int:
        return len(self.data)


@dataclass(frozen=True, slots=True)
class FrameChunk(Chunk):
    """Whatever one read of a CAN link returned: ``data`` is a frame batch (:mod:`firmware_protocol.can.frames`).

    The frames stand in order of reception, each with its own host time and the interface's raw time stamp;
    ``host_time_ns`` is that of the last. A recording keeps the bytes as they are.
    """

    @property
    def frames(self) -> list[CanFrame]:
        """The frames one by one; slow, for the few."""
        from firmware_protocol.can.frames import unpack_frames

        return unpack_frames(self.data)


AnyChunk: TypeAlias = Chunk | FrameChunk


class LinkEnd(Exception):  # noqa: N818 - not an error: a replay has an end, a live link has not
    """The link has delivered everything it will ever deliver."""


class Transport(Protocol):
    """An open link. ``read`` and ``close`` belong to one thread, ``write`` may come from another."""

    @property
    def name(self) -> str:
        """The link as a person would name it: its URI."""

    @property
    def is_live(self) -> bool:
        """Whether somebody may answer; False for a replay."""

    def read(self, timeout_s: float) -> AnyChunk | None:
        """Wait for the next chunk, at most ``timeout_s``; None when nothing came.

        Raises
        ------
        LinkEnd
            A replay is over.
        LinkLostError
            The link is gone.
        """

    @property
    def node(self) -> int | None:
        """Node id of the object on a bus; None on a link of one object, and while none is known."""

    @property
    def problems(self) -> tuple[str, ...]:
        """What a person should know of the link, a sentence each; only ever grows."""

    def encode_command(self, command: Command) -> bytes:
        """Make of a command what :meth:`write` takes: the frame of a serial link, the bare packet on CAN."""

    def write(self, data: bytes) -> None:
        """Send an encoded command.

        Raises
        ------
        LinkLostError
            The link is gone or does not take them within a second.
        """

    def close(self) -> None:
        """Give the link back; never raises, may be called twice."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class ClosingTransport:
    """What transports have in common: leaving one closes the link, and commands go as frames of a serial link."""

    @property
    def node(self) -> int | None:
        """No node id: one object."""
        return None

    @property
    def problems(self) -> tuple[str, ...]:
        """Nothing to tell."""
        return ()

    def encode_command(self, command: Command) -> bytes:
        """Frame a command for a serial link."""
        from firmware_protocol.serial.decoder import encode_command

        return encode_command(command)

    def close(self) -> None:
        """Give the link back."""
        raise NotImplementedError

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def joined(chunks: list[AnyChunk]) -> AnyChunk:
    """Make one chunk of several of a kind; it was received when the last of them was."""
    if len(chunks) == 1:
        return chunks[0]
    return type(chunks[0])(b"".join(chunk.data for chunk in chunks), chunks[-1].host_time_ns)
