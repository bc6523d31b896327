"""What CAN decoders count, beside what every decoder counts."""

from __future__ import annotations

from dataclasses import dataclass

from firmware_protocol.items import StreamCounters


@dataclass(frozen=True)
class CanCounters(StreamCounters):
    """What a decoder has met on the bus; a snapshot. ``frames`` are the data frames of its object."""

    error_frames: int = 0
    """Reported by the interface."""
    remote_frames: int = 0
    """No object of ours sends or answers them."""
    foreign_frames: int = 0
    """Frames with ids of other devices, 29-bit ids among them."""
    other_node_frames: int = 0
    """Frames of objects with another node id, and commands to all."""
    host_frames: int = 0
    """Commands and long packets to this object, from this host or another."""
    wrong_lengths: int = 0
    """Frames of the object whose length is not that of their function."""
    damaged_batches: int = 0
    """Frame batches of a recording that are not valid ones."""
    unnumbered: int = 0
    """Samples dropped because no TIME frame showed which they are."""
    misnumbered: int = 0
    """Samples delivered with a number 256 or more too low, as a later TIME frame showed."""
    refused: int = 0
    """Samples dropped because two objects share the node id."""
    long_packet_errors: int = 0
    """ISO-TP receptions and transmissions that failed."""
