"""What the golden vectors are made of. The expected counters are written by hand, not taken from the decoder."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from typing import Any

from cobs import cobs

from firmware_protocol import packets as p
from firmware_protocol import schema
from firmware_protocol.quantization import quat_to_q15, quats_to_smallest_three
from firmware_protocol.serial.framing import MAX_PACKET_BYTES, checksum, encode_frame
from firmware_protocol.wire_values import TO_WIRE

_SQRT_HALF = math.sqrt(0.5)
_TURNED = (math.cos(math.radians(20.0)), 0.0, 0.0, math.sin(math.radians(20.0)))
# Filters with a fast inverse square root leave such norms. Near the identity a component times 32767 is then beyond
# int16: rounded as it is, it would wrap to another rotation, with a right checksum and a right norm.
_NORM_ABOVE_ONE = (1.0001 * math.cos(math.radians(0.25)), 0.0, -1.0001 * math.sin(math.radians(0.25)), 0.0)

_CARD = p.ObjectCard(
    shape=p.ObjectShape.CUBE,
    size_mm=(60.0, 60.0, 60.0),
    surface="PLA, sanded",
    mass_g=142.5,
    com_mm=(0.0, -1.25, 3.5),
    weights=(p.InternalWeight(1, 12.34), p.InternalWeight(6, 50.0)),
    mounting_q_body_sensor=(0.0, 1.0, 0.0, 0.0),
)
_INFO = p.Info(
    device_id=0x0123456789ABCDEF,
    boot_id=0xC0FFEE42,
    firmware_version=(1, 4, 2),
    rate_hz=200,
    name="Würfel 1",
    sensor="ICM-42688-P",
    filter="VQF 6D",
    card=_CARD,
)
_SAMPLE = p.Orientation(1, 10_000, (1.0, 0.0, 0.0, 0.0), p.OrientationFlag.STILL)

PACKETS: tuple[tuple[str, p.Packet], ...] = (
    ("info of a cube", _INFO),
    ("info that knows nothing: NaN and empty texts", p.Info(device_id=1, boot_id=1)),
    ("orientation, identity, at rest", _SAMPLE),
    (
        "orientation, 40 deg about z, largest counters",
        p.Orientation(65535, 2**32 - 1, _TURNED, p.OrientationFlag.OVERRANGE | p.OrientationFlag.CALIBRATED),
    ),
    ("orientation, 0.5 deg from the identity, of norm 1.0001", p.Orientation(2, 20_000, _NORM_ABOVE_ONE)),
    ("orientation, all components negative", p.Orientation(0x1234, 0x12345678, (-0.5, -0.5, -0.5, -0.5))),
    (
        "status while streaming",
        p.Status(
            uptime_us=3_600_000_000 * 24,
            state=p.DeviceState.STREAMING,
            samples_produced=8_640_000,
            samples_dropped=17,
            battery_mv=3712,
            temperature_c=31.25,
            gyro_bias_dps=(0.125, -0.25, 0.031),
            errors=p.DeviceError.TRANSMIT_OVERFLOW,
        ),
    ),
    ("status of an idle object that knows no temperature", p.Status(uptime_us=0)),
    ("raw imu, at both ends of the scale", p.RawImu(7, 70_000, (-2000.0, 0.0, 1000.0), (0.0, 1.0, -16.0))),
    ("ack of SET_RATE: done", p.Ack(p.PacketType.SET_RATE, 3)),
    ("ack of a command the object does not know", p.Ack(0xEE, 4, p.AckCode.UNKNOWN_COMMAND)),
    ("time reply", p.TimeReply(9, 5_000_000_123, 5_000_000_456)),
    ("event: button 2", p.Event(123_456, p.EventKind.BUTTON, 2)),
    ("event: marker 513 took effect", p.Event(123_456, p.EventKind.MARKER, 513)),
    ("get info", p.GetInfo(1)),
    ("start", p.Start(2)),
    ("start with raw imu", p.Start(2, with_raw_imu=True)),
    ("stop", p.Stop(255)),
    ("set rate to 1000 Hz", p.SetRate(3, 1000)),
    ("identify for 3 s", p.Identify(5)),
    ("calibrate", p.Calibrate(6)),
    ("time request", p.TimeRequest(9)),
    ("mark 513", p.Mark(10, 513)),
)

QUATERNIONS: tuple[tuple[float, float, float, float], ...] = (
    (1.0, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, -1.0),
    (0.5, 0.5, 0.5, 0.5),
    (_SQRT_HALF, 0.0, -_SQRT_HALF, 0.0),
    (-0.1, 0.7, 0.1, -0.7),
    _TURNED,
    (1.0001, 0.0, 0.0, 0.0),
    (0.0, 0.0, -1.0001, 0.0),
    _NORM_ABOVE_ONE,
)


def fields_of(packet: p.Packet) -> dict[str, Any]:
    """Return a packet's fields under the names of its field table, for JSON: NaN becomes null, members their number."""
    fields = {field.name: getattr(packet, field.name) for field in dataclasses.fields(packet)}
    card = fields.pop("card", None)
    if card is not None:
        fields |= {field.name: getattr(card, field.name) for field in dataclasses.fields(card)}
        fields["weights"] = [dataclasses.asdict(weight) for weight in card.weights]
        fields["weight_count"] = len(card.weights)
    return {name: _plain(value) for name, value in fields.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_plain(part) for part in value]
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    return None if math.isnan(value) else int(value) if isinstance(value, int) else value


def _bytes_of(packet: p.Packet) -> bytes:
    return schema.build(packet.packet_type, TO_WIRE[packet.packet_type](packet))


def _stream(name: str, meaning: str, data: bytes, sequences: Sequence[int] = (), **counters: int) -> dict[str, Any]:
    return {"name": name, "meaning": meaning, "bytes": data.hex(), "sequences": list(sequences), "counters": counters}


def _streams() -> list[dict[str, Any]]:
    """Byte streams and the counters they must lead to; counters not named stay zero but for bytes and delimiters."""
    a, b, c = (_bytes_of(dataclasses.replace(_SAMPLE, sequence=k)) for k in (1, 2, 3))
    fa, fb, fc = map(encode_frame, (a, b, c))
    wrong_crc = bytearray(fb)
    wrong_crc[-2] ^= 0x01
    wrong_code = bytearray(fb)
    wrong_code[1] = 0x30
    off_norm = b"\x02" + bytes(6) + (0x4000).to_bytes(2, "little") + bytes(7)
    return [
        _stream("two frames", "both received", fa + fb, (1, 2), frames=2, frame_bytes=38),
        _stream("shared delimiter", "0x00 ends one and begins the next", fa + fb[1:], (1, 2), frames=2, frame_bytes=38),
        _stream("idle zeros", "empty pieces are nothing", bytes(5) + fa + bytes(5), (1,), frames=1, frame_bytes=19),
        _stream(
            "joined midway", "the rest of a frame in front of the first delimiter is no error",
            fa[5:] + fb, (2,), frames=1, frame_bytes=19, skipped_bytes=15, partial_starts=1,
        ),
        _stream(
            "boot text", "text between frames is a piece that is no frame",
            fa + b"boot ok\r\n" + fb, (1, 2), frames=2, frame_bytes=38, skipped_bytes=9, cobs_errors=1,
        ),
        _stream(
            "wrong checksum", "the frame is skipped, its neighbours are received",
            fa + bytes(wrong_crc) + fc, (1, 3),
            frames=2, frame_bytes=38, skipped_bytes=19, crc_errors=1, sequence_gaps=1, samples_lost=1,
        ),
        _stream(
            "wrong code", "a COBS code that points past the end",
            fa + bytes(wrong_code) + fc, (1, 3),
            frames=2, frame_bytes=38, skipped_bytes=19, cobs_errors=1, sequence_gaps=1, samples_lost=1,
        ),
        _stream(
            "byte lost", "a byte is missing inside a frame",
            fa + fb[:8] + fb[9:] + fc, (1, 3),
            frames=2, frame_bytes=38, skipped_bytes=18, cobs_errors=1, sequence_gaps=1, samples_lost=1,
        ),
        _stream(
            "zero for a byte", "a frame cut in two by a 0x00 is two pieces; the first is COBS by chance",
            fa + fb[:8] + b"\0" + fb[9:] + fc, (1, 3),
            frames=2, frame_bytes=38, skipped_bytes=18, crc_errors=1, cobs_errors=1, sequence_gaps=1, samples_lost=1,
        ),
        _stream(
            "too short for a checksum", "one byte only",
            fa + b"\x02\x55\0" + fb, (1, 2), frames=2, frame_bytes=38, skipped_bytes=2, crc_errors=1,
        ),
        _stream(
            "oversize", "a piece of 256 bytes cannot be a frame",
            fa + b"\x55" * 256 + fb, (1, 2), frames=2, frame_bytes=38, skipped_bytes=256, oversize=1,
        ),
        _stream(
            "cut off", "the start of a frame waits for its rest",
            fa + fb[:10], (1,), frames=1, frame_bytes=19, pending_bytes=9,
        ),
        _stream(
            "empty packet", "a checksum of nothing is right, but there is no type byte",
            b"\0" + cobs.encode(b"\xff\xff") + b"\0", frames=1, frame_bytes=3, malformed=1,
        ),
        _stream(
            "truncated packet", "an ORIENTATION of 15 bytes with the right checksum",
            encode_frame(a[:-1]), frames=1, frame_bytes=18, malformed=1,
        ),
        _stream(
            "norm off", "a quaternion of norm 0.5 is refused, not normalised",
            encode_frame(off_norm), frames=1, frame_bytes=19, malformed=1,
        ),
        _stream(
            "state that is none", "STATUS with state 9",
            encode_frame(_bytes_of(p.Status(uptime_us=1))[:9] + b"\x09" + bytes(24)),
            frames=1, frame_bytes=37, malformed=1,
        ),
        _stream(
            "unknown type", "a packet type of a newer minor version is skipped",
            fa + encode_frame(b"\x40newer") + fb, (1, 2), frames=3, frame_bytes=47, unknown_types=1,
        ),
        _stream(
            "longer packet", "ORIENTATION of a newer minor version with two more bytes: what is known is read",
            encode_frame(a + b"\x07\x00"), (1,), frames=1, frame_bytes=21, extended=1,
        ),
        _stream(
            "other major version", "INFO of version 2.3: nothing but the version is read",
            encode_frame(b"\x01\x02\x03whatever follows"), frames=1, frame_bytes=22, unsupported_versions=1,
        ),
        _stream(
            "duplicate", "the same sample twice",
            fa + fb + fb + fc, (1, 2, 2, 3), frames=4, frame_bytes=76, duplicates=1,
        ),
        _stream(
            "reordered", "3 before 2: first a gap, then no loss after all",
            fa + fc + fb, (1, 3, 2), frames=3, frame_bytes=57, sequence_gaps=1, reordered=1,
        ),
        _stream(
            "sequence wrap", "65535 is followed by 0",
            b"".join(encode_frame(_bytes_of(dataclasses.replace(_SAMPLE, sequence=k))) for k in (65534, 65535, 0, 2)),
            (65534, 65535, 0, 2), frames=4, frame_bytes=76, sequence_gaps=1, samples_lost=1,
        ),
        _stream(
            "reset", "INFO with another boot id: the sequence begins anew, nothing is lost",
            encode_frame(_bytes_of(p.Info(1, 1))) + fc + encode_frame(_bytes_of(p.Info(1, 2))) + fa, (3, 1),
            frames=4, frame_bytes=38 + 2 * 205,
        ),
    ]  # fmt: skip


def make_vectors() -> dict[str, Any]:
    """Return all vectors."""
    checksums = (b"123456789", b"", b"\0", b"\xff\xff", bytes(range(256)))
    stuffed = (b"", b"\0", b"\0\0", b"\x11\x22\0\x33", b"\x11\0\0\0", bytes(range(1, 255)), b"\x01" * 254)
    return {
        "protocol": f"{p.PROTOCOL_MAJOR}.{p.PROTOCOL_MINOR}",
        "about": "Serial protocol of the sensorized object; see docs/protocol.md. Bytes are hexadecimal, null is NaN.",
        "max_packet_bytes": MAX_PACKET_BYTES,
        "crc16": [{"bytes": data.hex(), "crc": f"{checksum(data):04x}"} for data in checksums],
        "cobs": [{"bytes": data.hex(), "cobs": cobs.encode(data).hex()} for data in stuffed],
        "quaternions": [
            {
                "q_wxyz": list(quat),
                "q15": list(quat_to_q15(quat)),
                "smallest_three": f"{int(quats_to_smallest_three([quat])[0]):014x}",
            }
            for quat in QUATERNIONS
        ],
        "packets": [
            {
                "name": name,
                "packet_type": packet.packet_type.name,
                "fields": fields_of(packet),
                "packet": _bytes_of(packet).hex(),
                "frame": encode_frame(_bytes_of(packet)).hex(),
            }
            for name, packet in PACKETS
        ],
        "streams": _streams(),
    }


def vectors_text() -> str:
    """Return the content of the vectors' file."""
    return json.dumps(make_vectors(), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
