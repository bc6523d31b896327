"""The channels of a recording that are made from its raw ones: samples, packets and end points, for viewers."""

from __future__ import annotations

from dataclasses import asdict

from firmware_protocol.packets import Event, Info, Status
from host.recording import format as fmt
from host.recording.writer import RecordingWriter
from host.trial.live import TrialUpdate


def add_views(recording: RecordingWriter, update: TrialUpdate, host_time_ns: int) -> None:
    """Record what the trial made of one chunk, which was received at ``host_time_ns`` and is recorded already."""
    for batch in update.decoded:
        recording.add_orientations(batch.stamps_ns, batch.quats_wxyz, host_time_ns)
    for item in update.items:
        if isinstance(item, Info | Status | Event):
            recording.add_packet(item, host_time_ns)
    for row in update.cycles:
        recording.add_values(fmt.ENDPOINT, {**asdict(row), "flags": ", ".join(row.flags)}, host_time_ns)
