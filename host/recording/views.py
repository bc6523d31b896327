"""The channels of a recording that are made from its raw ones: samples, packets and end points, for viewers."""

from __future__ import annotations

from firmware_protocol.packets import Event, Info, Status
from host.recording import format as fmt
from host.recording.writer import RecordingWriter
from host.trial.live import TrialUpdate


def add_views(recording: RecordingWriter, update: TrialUpdate, host_time_ns: int) -> None:
    """Record what one chunk came to.

    Parameters
    ----------
    recording : RecordingWriter
        Has recorded the chunk itself already.
    update : TrialUpdate
        What the trial made of it.
    host_time_ns : int
        Its reception.
    """
    for batch in update.decoded:
        recording.add_orientations(batch.stamps_ns, batch.quats_wxyz, host_time_ns)
    for item in update.items:
        if isinstance(item, Info):
            recording.add_packet(fmt.INFO, item, host_time_ns)
        elif isinstance(item, Status):
            recording.add_packet(fmt.STATUS, item, host_time_ns)
        elif isinstance(item, Event):
            recording.add_packet(fmt.EVENT, item, host_time_ns)
    for row in update.cycles:
        values = {
            "number": row.number,
            "time_s": row.time_s,
            "period_s": row.period_s,
            "step_deg": row.step_deg,
            "theta_bar_deg": row.theta_bar_deg,
            "flags": ", ".join(row.flags),
        }
        recording.add_values(fmt.ENDPOINT, values, host_time_ns)
