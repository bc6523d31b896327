"""What the golden vectors of the CAN mapping are made of. What each must decode to is written by hand."""

from __future__ import annotations

import json
import math
from typing import Any

from firmware_protocol import packets as p
from firmware_protocol.can.encoder import CanObject, command_frame
from firmware_protocol.can.frames import CanFrame
from firmware_protocol.can.iso_tp import LongPacketChannel
from firmware_protocol.codec import encode_packet

NODE = 5
_TURNED = (math.cos(math.radians(20.0)), 0.0, 0.0, math.sin(math.radians(20.0)))
_STILL = p.OrientationFlag.STILL
_SAMPLES = (
    p.Orientation(254, 4_294_967_290, (1.0, 0.0, 0.0, 0.0), _STILL),
    p.Orientation(255, 4_294_967_290 + 5000 - 2**32, (-0.5, 0.5, -0.5, 0.5), _STILL),
    p.Orientation(256, 4_294_967_290 + 10_000 - 2**32, _TURNED),
    p.Orientation(257, 4_294_967_290 + 15_000 - 2**32, (0.0, 0.0, -1.0, 0.0)),
)
_RARE: tuple[p.DevicePacket, ...] = (
    p.Status(
        2**40 + 1, p.DeviceState.STREAMING, 2**33, 17, 3712, -12.34, (0.001, -1.5, 32.0), p.DeviceError.LOW_BATTERY
    ),
    p.Ack(0x84, 200, p.AckCode.INVALID_ARGUMENT),
    p.TimeReply(17, 2**40 + 5, 2**40 + 99),
    p.Event(4_000_000_000, p.EventKind.MARKER, 513),
    p.RawImu(257, 4_294_967_290 + 15_000 - 2**32, (1.0, -2.0, 0.25), (0.5, 0.0, -1.0)),
)
_COMMANDS: tuple[p.Command, ...] = (
    p.GetInfo(1),
    p.Start(2, True),
    p.SetRate(3, 1000),
    p.Mark(4, 513),
    p.TimeRequest(5),
)


_INFO = p.Info(
    device_id=0x0123456789ABCDEF,
    boot_id=0xC0FFEE42,
    rate_hz=200,
    name="cube",
    card=p.ObjectCard(p.ObjectShape.CUBE, (60.0, 60.0, 60.0), "PLA", 142.5, (0.0, 0.0, -1.5)),
)


def _frame(frame: CanFrame) -> dict[str, Any]:
    return {"id": f"{frame.arbitration_id:03X}", "fd": frame.is_fd, "data": frame.data.hex()}


def _object(fd: bool) -> CanObject:
    end = CanObject(NODE, fd)
    end.encode([encode_packet(_INFO)])
    return end


def _long(fd: bool) -> list[CanFrame]:
    """Return the frames of INFO, and between them the flow control of the host."""
    host, end = LongPacketChannel(NODE, is_object=False, fd=fd), CanObject(NODE, fd)
    first = end.encode([encode_packet(_INFO)])
    host.feed(first[0].data)
    (flow_control,) = host.take_outgoing()
    _, rest = end.receive(flow_control)
    return [*first, flow_control, *rest]


def can_vectors_text() -> str:
    """Return ``can.json``: packets of the object and commands, with the frames that carry them."""
    vectors = []
    for fd in (False, True):
        end = _object(fd)
        for packet in (*_SAMPLES, *_RARE):
            data = encode_packet(packet)
            frames = [_frame(frame) for frame in end.encode([data])]
            vectors.append({"packet": packet.packet_type.name, "bytes": data.hex(), "fd": fd, "frames": frames})
        vectors.append(
            {
                "packet": "INFO",
                "bytes": encode_packet(_INFO).hex(),
                "fd": fd,
                "frames": [_frame(frame) for frame in _long(fd)],
            }
        )
        for command in _COMMANDS:
            data = encode_packet(command)
            frames = [_frame(command_frame(data, NODE, fd))]
            vectors.append({"packet": command.packet_type.name, "bytes": data.hex(), "fd": fd, "frames": frames})
    document = {
        "protocol": f"{p.PROTOCOL_MAJOR}.{p.PROTOCOL_MINOR}",
        "node": NODE,
        "object": "device id 0123456789abcdef, boot id c0ffee42, 200 Hz; packets in order, from the first sample on",
        "vectors": vectors,
    }
    return json.dumps(document, indent=1) + "\n"
