"""What CAN decoders count."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.items import StreamCounters


@dataclass(frozen=True)
class CanCounters(StreamCounters):
    """What a decoder has met on the bus: those of a serial stream, and what only CAN has; a frozen snapshot."""

    error_frames: int = 0
    """Reported by the interface."""
    remote_frames: int = 0
    """No object of ours sends or answers them."""
    foreign_frames: int = 0
    """Ids that are none of ours, 29-bit ids among them."""
    other_node_frames: int = 0
    """Frames of objects with another node id."""
    host_frames: int = 0
    """Commands and long packets from a host to this object, ours or another's."""
    wrong_lengths: int = 0
    """Frames of ours whose length is not that of their function."""
    damaged_batches: int = 0
    """Frame batches of a recording that are none."""
    unnumbered: int = 0
    """Samples dropped because no TIME frame said which they are."""
    misnumbered: int = 0
    """Samples delivered with a number 256 or more too low, as a later TIME frame showed."""
    refused: int = 0
    """Samples dropped because two objects share the node id."""
    long_packet_errors: int = 0
    """ISO-TP receptions and transmissions that failed."""
