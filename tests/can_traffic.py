"""CAN traffic of a simulated object, with frames removed on purpose, and where each sample really belongs."""

from __future__ import annotations

import dataclasses
from unittest.mock import patch

import numpy as np

from firmware_protocol.can.encoder import CanObject
from firmware_protocol.can.frames import CanFrame
from firmware_protocol.can.iso_tp import LongPacketChannel, flow_control
from firmware_protocol.can.mapping import NODE_BITS, CanFunction, split_id
from firmware_protocol.codec import encode_packet
from firmware_protocol.items import StreamItem
from firmware_protocol.packets import Info, Orientation, OrientationBatch, OrientationFlag


def unit_quaternions(n: int, seed: int = 1) -> np.ndarray:
    quats = np.random.default_rng(seed).normal(size=(n, 4))
    return quats / np.linalg.norm(quats, axis=1)[:, None]


def sample_packets(
    n: int,
    rate_hz: int = 1000,
    first: int = 0,
    time_us: int = 100,
    flags: np.ndarray | None = None,
    quats: np.ndarray | None = None,
) -> list[bytes]:
    quats = unit_quaternions(n) if quats is None else quats
    flags = np.zeros(n, np.uint8) if flags is None else flags
    return [
        encode_packet(
            Orientation(
                (first + k) & 0xFFFF,
                (time_us + k * 1_000_000 // rate_hz) & 0xFFFFFFFF,
                tuple(quats[k].tolist()),
                OrientationFlag(int(flags[k])),
            )
        )
        for k in range(n)
    ]


def info_packet(device_id: int = 7, boot_id: int = 9, rate_hz: int = 1000) -> bytes:
    return encode_packet(Info(device_id=device_id, boot_id=boot_id, rate_hz=rate_hz, name="cube"))


class PatientObject(CanObject):
    """An object that waits for flow control without end: the machine's clock has no say in what it sends."""

    def _open_channel(self) -> LongPacketChannel:
        with patch("firmware_protocol.can.iso_tp.FLOW_CONTROL_MS", 10**9):
            return super()._open_channel()


def object_at(node: int = 3, fd: bool = False, **info: int) -> CanObject:
    """Return an object that has powered up: its INFO has gone to nobody."""
    end = PatientObject(node, fd)
    end.encode([info_packet(**info)])
    return end


def timed(end: CanObject, packets: list[bytes], period_ns: int, start_ns: int = 1_000_000_000) -> list[CanFrame]:
    """Frames of packets; of samples each with the time of its reception."""
    frames = end.encode(packets)
    ends_packet = [is_sample(frame) for frame in frames]
    if sum(ends_packet) == len(packets):  # all at once: much faster
        numbers = np.cumsum([0, *ends_packet[:-1]]).tolist()
        return [
            dataclasses.replace(frame, host_time_ns=start_ns + k * period_ns)
            for frame, k in zip(frames, numbers, strict=True)
        ]
    return [dataclasses.replace(frame, host_time_ns=start_ns) for frame in frames]


def answers(frames: list[CanFrame]) -> list[CanFrame]:
    """What a host answers at once to frames of an object: flow control for its long packets."""
    ids = [(frame, split_id(frame.arbitration_id)) for frame in frames]
    found = [
        flow_control(frame.data, identity.node, identity.whole_packet)
        for frame, identity in ids
        if identity is not None and identity.function is CanFunction.LONG_FROM_OBJECT
    ]
    return [answer for answer in found if answer is not None]


def is_sample(frame: CanFrame) -> bool:
    return frame.arbitration_id >> NODE_BITS & 0x1F == CanFunction.ORIENTATION


def sample_rows(frames: list[CanFrame]) -> list[int]:
    return [row for row, frame in enumerate(frames) if is_sample(frame)]


def joined(items: list[StreamItem]) -> OrientationBatch:
    batches = [item for item in items if isinstance(item, OrientationBatch)]
    if not batches:
        return OrientationBatch(np.empty(0, np.uint16), np.empty(0, np.uint32), np.empty((0, 4)), np.empty(0, np.uint8))
    return OrientationBatch(
        np.concatenate([batch.sequence for batch in batches]),
        np.concatenate([batch.device_time_us for batch in batches]),
        np.concatenate([batch.quats_wxyz for batch in batches]),
        np.concatenate([batch.flags for batch in batches]),
    )


def fed(decoder: object, frames: list[CanFrame], at_once: int) -> list[StreamItem]:
    """Everything a decoder makes of frames, given a few at a time."""
    from firmware_protocol.can.frames import pack_frames

    items: list[StreamItem] = []
    for start in range(0, len(frames), at_once):
        items += decoder.feed(pack_frames(frames[start : start + at_once]))
    return items + decoder.flush()
